"""What statistics and figures are called wherever people read them: the same word in every table and sentence."""

from collections.abc import Iterable
from typing import Final

_WORDS: Final = {"p50": "median"}

LATENCY_PARTS: Final = {
    "surgeon": "surgeon (sample taken to sent)",
    "network": "+ network (sent to received)",
    "tick_wait": "+ tick wait (until the next tick)",
    "compute": "+ compute (until published)",
    "end_to_end": "= end to end",
}
"""The parts that the end-to-end latency adds up from, in this order."""

ROUND_TRIP: Final = "round trip (surgeon's clock)"


def said(name: str) -> str:
    """Return the word for a statistic of the summary: median for ``p50``; mean, std, p95, p99 and max are words."""
    return _WORDS.get(name, name)


def heads(names: Iterable[str], unit: str = "") -> tuple[str, ...]:
    """Return the heads of columns that hold statistics, each with its unit where the columns have one."""
    return tuple(f"{said(name)}, {unit}" if unit else said(name) for name in names)


def percentile_said(percent: float | None) -> str:
    """Return the word for a percentile: ``p99`` for 99; nothing for none."""
    return "" if percent is None else said(f"p{percent:g}")
