"""What statistics and figures are called wherever people read them: the same word in every table and sentence."""

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
"""The parts that the end-to-end latency adds up from, in this order."""

ROUND_TRIP: Final = "round trip (surgeon's clock)"


def heads(names: Iterable[str], unit: str = "") -> tuple[str, ...]:
    """Return the heads of columns that hold statistics, each with its unit where the columns have one."""
    return tuple(f"{statistic_name(name)}, {unit}" if unit else statistic_name(name) for name in names)
