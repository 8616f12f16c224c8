"""Whether a network was the one that was asked for, in a few words, and what of it could not be told."""

from collections.abc import Mapping
from typing import Any, Final

STYLES: Final = {True: "green", False: "red", None: "yellow"}
"""How a terminal shows each answer."""


def faith_in_words(verdict: Mapping[str, Any], asked: str) -> str:
    """Return the answer to ``verdict["faithful"]``; ``asked``: to what, `the scenario` or `what was asked`."""
    if verdict["faithful"] is None:
        return "not decidable, too little was sent"
    if not verdict["faithful"]:
        return f"not faithful to {asked}"
    left_open = undecided(verdict)
    return f"faithful to {asked} as far as can be told ({left_open})" if left_open else f"faithful to {asked}"


def undecided(verdict: Mapping[str, Any]) -> str:
    """Return what could not be judged, all keys together: ``loss: not decidable with 450 messages``."""
    return "; ".join(
        f"{what}: not decidable" + ("" if n is None else f" with {n} message{'s' if n != 1 else ''}")
        for what, n in verdict.get("undecided", {}).items()
    )
