"""Numbers, figures and names of statistics as text."""

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

from tis.common.metrics.percentiles import is_resolvable
from tis.deploy.report.measures.uncertainty import figures_at
from tis.deploy.report.verdict.amounts import statistic_name

LATENCY_PARTS: Final = {
    "surgeon": "surgeon (sample taken to sent)",
    "network": "+ network (sent to received)",
    "tick_wait": "+ tick wait (until the next tick)",
    "compute": "+ compute (until published)",
    "end_to_end": "= end to end",
}
"""The parts of the end-to-end latency, in order; they add up to it."""

NOT_RESOLVABLE: Final = "not resolvable"
"""Text of a figure that the clock uncertainty exceeds."""

ROUND_TRIP: Final = "round trip (surgeon's clock)"


def number(value: float | None, unit: str = "") -> str:
    """Return a number with three or four significant digits, a dash for none."""
    if value is None:
        return "-"
    if isinstance(value, int):
        return f"{value}{unit}"
    digits = 0 if abs(value) >= 1000 else 1 if abs(value) >= 100 else 2 if abs(value) >= 1 else 3
    if 99.9 <= value < 100 and not unit:
        digits, value = 3, math.floor(1000 * value) / 1000  # only a full 100 is shown as 100
    return f"{value:.{digits}f}{unit}"


def figure(summary: Mapping[str, Any], place: str, name: str, unit: str = "") -> str:
    """Return a figure of the summary as text: ``12.41 ms``, ``12.41 ± 0.08 ms``, or ``not resolvable``.

    ``place`` is dotted. The margin is the clock uncertainty, rounded up; a single clock has none.
    """
    value = figures_at(summary, place)[name]
    bound = summary.get("uncertainty_ms", {}).get(place, {}).get(name)
    if value is None or not bound:
        return number(value, unit)
    if not is_resolvable(value, bound):
        return NOT_RESOLVABLE
    text = number(value)
    return f"{text} ± {rounded_up(bound, len(text.partition('.')[2]))}{unit}"


def unresolved_latency(summary: Mapping[str, Any]) -> str | None:
    """Return a sentence when the clock uncertainty exceeds the latency itself, else None."""
    if "latency_ms.end_to_end.p50" not in summary.get("not_resolvable", ()):
        return None
    bound_ms = summary["uncertainty_ms"]["latency_ms.end_to_end"]["p50"]
    margin = f"\u00b1 {rounded_up(bound_ms, 2)} ms"
    return f"the latency of the estimates is not resolvable, the clocks are uncertain by {margin}"


def rounded_up(value: float, digits: int) -> str:
    """Return a value with ``digits`` decimals, rounded up as bounds must be."""
    return f"{math.ceil(round(value * 10**digits, 6)) / 10**digits:.{digits}f}"


def broken_name(name: str, width: int) -> str:
    """Return a name with line breaks where it exceeds ``width``: after its colon, then every ``width`` characters."""
    parts = [name] if len(name) <= width else name.replace(":", ":\n").split("\n")
    return "\n".join(part[at : at + width] for part in parts for at in range(0, len(part), width))


def heads(names: Iterable[str], unit: str = "") -> tuple[str, ...]:
    """Return the column heads of statistics, with ``unit`` if there is one."""
    return tuple(f"{statistic_name(name)}, {unit}" if unit else statistic_name(name) for name in names)
