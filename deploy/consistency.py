"""Live fates against the twin's (L1): the same packet, lost or as late, in both."""

from dataclasses import dataclass
from typing import Any, Final

from common.records import FATES
from common.scenario import Scenario
from common.scenario.network import TimelineEntry
from common.units import NS_PER_MS, s_to_ns
from deploy.report.load import RunLogs

_EDGE_NS: Final = 50 * NS_PER_MS


@dataclass(frozen=True)
class FateComparison:
    """Packets of two runs of one scenario, matched by direction, key and sequence number.

    Set aside are packets offered within 50 ms of an outage's edge: an outage holds in run time, not by number.
    """

    n_compared: int
    n_different: int
    n_set_aside: int
    n_in_one_only: int

    @property
    def identical(self) -> bool:
        """Tell whether every packet that both runs offered had one fate."""
        return self.n_compared > 0 and self.n_different == 0


def compare_fates(live: RunLogs, twin: RunLogs, scenario: Scenario) -> FateComparison:
    """Compare what netem decided, by sequence number: the outcome and the delay drawn.

    The release instant is left out; it follows from the arrival, and with ``fifo`` from other packets too.
    """
    one, other = _fates(live), _fates(twin)
    edges_ns = [ns for entry in scenario.network.timeline for ns in _edges_ns(entry)]
    n_different = n_set_aside = 0
    shared = one.keys() & other.keys()
    for packet in shared:
        a, b = one[packet], other[packet]
        if any(abs(row["offered_ns"] - ns) < _EDGE_NS for ns in edges_ns for row in (a, b)):
            n_set_aside += 1
        elif (a["outcome"], a["delay_ns"]) != (b["outcome"], b["delay_ns"]):
            n_different += 1
    return FateComparison(len(shared) - n_set_aside, n_different, n_set_aside, len(one.keys() ^ other.keys()))


def _edges_ns(entry: TimelineEntry) -> tuple[int, int]:
    return s_to_ns(entry.at_s), s_to_ns(entry.at_s + entry.for_s)


def _fates(logs: RunLogs) -> dict[tuple[str, str, int], dict[str, Any]]:
    rows = logs.of("netem", FATES)
    return {(row["direction"], row["key"], row["seq"]): row for row in rows if not row["foreign"]}
