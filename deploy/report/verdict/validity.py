"""Whether a run is a valid measurement, and of which network: two questions, one sentence."""

from collections.abc import Mapping
from typing import Any


def validity(summary: Mapping[str, Any], since: str | None = None) -> str:
    """Return the sentence; a colon at its end announces the problems.

    ``since`` is what came upon the logs after the summary was made, in words, which then speaks of what was.

    Valid: the logs are whole, their books balance and no process was starved, so the figures are what happened.
    Faithful: what happened is the network that the scenario asks for. A run may be the one without the other.
    """
    if not summary["valid"]:
        return "This run is not a valid measurement:"
    unlike = [name for name, link in summary["links"].items() if link.get("verdict", {}).get("faithful") is False]
    is_one = f"Before {since} this run was a valid measurement" if since else "This run is a valid measurement"
    if not unlike:
        return f"{is_one}."
    return (
        f"{is_one}, but not of the network that the scenario asks for "
        f"({' and '.join(unlike)}): its figures hold for the network that there was."
    )
