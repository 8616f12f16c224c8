"""Validity of a run and fidelity of its network, as sentences."""

from collections.abc import Mapping
from typing import Any, Final

from tis.common.metrics.verdict import SetVerdict

OUT_OF_REACH: Final = "out of reach"
FIDELITY_STYLES: Final = {True: "green", False: "red", None: "yellow"}
"""Terminal style of each value of ``verdict["faithful"]``."""

_AT_A_TICK: Final = ("end_to_end", "age", "round_trip")
_MS_PER_S: Final = 1000


def validity_text(summary: Mapping[str, Any], since: str | None = None) -> str:
    """Return the sentence on validity; a colon at its end announces the problems.

    Valid: the logs are complete, their packet counts balance and no process was starved, so the figures are what
    happened. Faithful: what happened is the network of the scenario. A run may be one without the other. ``since``
    names damage to the logs after the summary was written; the sentence is then in the past tense.
    """
    if not summary["valid"]:
        return "This run is not a valid measurement:"
    unlike = [name for name, link in summary["links"].items() if link.get("verdict", {}).get("faithful") is False]
    is_one = f"Before {since} this run was a valid measurement" if since else "This run is a valid measurement"
    if not unlike:
        return f"{is_one}."
    return (
        f"{is_one}, but not of the network that the scenario requests "
        f"({' and '.join(unlike)}): its figures hold for the network that there was."
    )


def outcome_text(verdict: SetVerdict, rate_hz: int) -> str:
    """Return a set's outcome in words: "out of reach" where it is missed and allows less time than a tick takes."""
    if verdict["outcome"] == "missed" and _least_ms(verdict) < _MS_PER_S / rate_hz:
        return OUT_OF_REACH
    return verdict["outcome"].replace("_", " ")


def _least_ms(verdict: SetVerdict) -> float:
    """Return the shortest time that a set allows from a sample to its use or its answer, inf without any."""
    limits = [one["limit"] for one in verdict["findings"] if one["binding"] and one["metric"] in _AT_A_TICK]
    return min(limits, default=float("inf"))


def fidelity_text(verdict: Mapping[str, Any], request: str) -> str:
    """Return a link's ``verdict["faithful"]`` in words; ``request``: `the scenario` or `the requested network`."""
    if verdict["faithful"] is None:
        return "not decidable, too little was sent"
    if not verdict["faithful"]:
        return f"not faithful to {request}"
    left_open = undecided_text(verdict)
    return (
        f"faithful to {request} in all that could be judged ({left_open})" if left_open else f"faithful to {request}"
    )


def undecided_text(verdict: Mapping[str, Any]) -> str:
    """Return the criteria that could not be judged, all keys together: ``loss: not decidable with 450 messages``."""
    return "; ".join(
        f"{what}: not decidable" + ("" if n is None else f" with {n} message{'s' if n != 1 else ''}")
        for what, n in verdict.get("undecided", {}).items()
    )
