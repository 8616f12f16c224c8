"""Numbers and figures of the summary as text."""

import math
from collections.abc import Mapping
from typing import Any

from common.clocks.figures import is_resolvable
from deploy.report.measures.uncertainty import figures_at


def number(value: float | None, unit: str = "") -> str:
    """Return a number with three or four significant digits, a dash for none."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return f"{value}{unit}"
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 100 else 2 if abs(value) >= 1 else 3
    if 99.9 <= value < 100 and not unit:
        digits, value = 3, math.floor(1000 * value) / 1000  # what is not all is never shown as 100
    return f"{value:.{digits}f}{unit}"


def figure(summary: Mapping[str, Any], place: str, name: str, unit: str = "") -> str:
    """Return a figure of the summary as people read it: ``12.41 ms``, ``12.41 ± 0.08 ms``, or ``not resolvable``.

    ``place`` is dotted. The uncertainty is what the clocks leave open, rounded up; one clock leaves nothing open.
    """
    value = figures_at(summary, place)[name]
    bound = summary.get("uncertainty_ms", {}).get(place, {}).get(name)
    if value is None or not bound:
        return number(value, unit)
    if not is_resolvable(value, bound):
        return "not resolvable"
    text = number(value)
    return f"{text} ± {rounded_up(bound, len(text.partition('.')[2]))}{unit}"


def unresolved_latency(summary: Mapping[str, Any]) -> str | None:
    """Return, where the clocks leave the latency open by more than its own size, that they do."""
    if "latency_ms.end_to_end.p50" not in summary.get("not_resolvable", ()):
        return None
    open_ms = summary["uncertainty_ms"]["latency_ms.end_to_end"]["p50"]
    return f"how late the estimates were is not resolvable, the clocks leave \u00b1 {rounded_up(open_ms, 2)} ms open"


def rounded_up(value: float, digits: int) -> str:
    return f"{math.ceil(round(value * 10**digits, 6)) / 10**digits:.{digits}f}"


def broken_name(name: str, most: int) -> str:
    """Return a name of up to ``most`` characters as it is, a longer one broken behind its colon and where it must."""
    parts = [name] if len(name) <= most else name.replace(":", ":\n").split("\n")
    return "\n".join(part[at : at + most] for part in parts for at in range(0, len(part), most))
