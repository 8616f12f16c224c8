"""Whether a run is a valid measurement, and of which network: two questions, one sentence."""

from collections.abc import Mapping
from typing import Any


def validity(summary: Mapping[str, Any]) -> str:
    """Return the sentence; a colon at its end announces the problems.

    Valid: the logs are whole, their books balance and no process was starved, so the figures are what happened.
    Faithful: what happened is the network that the scenario asks for. A run may be the one without the other.
    """
    if not summary["valid"]:
        return "This run is not a valid measurement:"
    unlike = [name for name, link in summary["links"].items() if link.get("verdict", {}).get("faithful") is False]
    if not unlike:
        return "This run is a valid measurement."
    return (
        "This run is a valid measurement, but not of the network that the scenario asks for "
        f"({' and '.join(unlike)}): its figures hold for the network that there was."
    )
