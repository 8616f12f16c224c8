"""Names of statistics and latency parts in tables and sentences."""

from collections.abc import Iterable
from typing import Final

from deploy.report.verdict.amounts import statistic_name

LATENCY_PARTS: Final = {
    "surgeon": "surgeon (sample taken to sent)",
    "network": "+ network (sent to received)",
    "tick_wait": "+ tick wait (until the next tick)",
    "compute": "+ compute (until published)",
    "end_to_end": "= end to end",
}
"""The parts of the end-to-end latency, in order; they add up to it."""

ROUND_TRIP: Final = "round trip (surgeon's clock)"


def heads(names: Iterable[str], unit: str = "") -> tuple[str, ...]:
    """Return the column heads of statistics, with ``unit`` if there is one."""
    return tuple(f"{statistic_name(name)}, {unit}" if unit else statistic_name(name) for name in names)
