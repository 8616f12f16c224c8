"""Live fates against the twin's (L1): the same packet, lost or as late, in both."""

from dataclasses import dataclass
from typing import Any, get_args

from common.channels import Direction
from common.records import FATES
from common.scenario import Scenario
from deploy.report.load import RunLogs
from netem.outage import Outages


@dataclass(frozen=True)
class FateComparison:
    """Packets of two runs of one scenario, matched by direction, key and sequence number.

    Set aside are packets that one run offered within an outage and the other outside: an outage holds in run time,
    and the host's jitter may move a packet over its edge.
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
    outages = {way: Outages.of_timeline(scenario.network.timeline, way) for way in get_args(Direction)}
    n_different = n_set_aside = 0
    shared = one.keys() & other.keys()
    for packet in shared:
        a, b = one[packet], other[packet]
        out = outages[packet[0]]
        if out.holds(a["offered_ns"]) != out.holds(b["offered_ns"]):
            n_set_aside += 1
        elif (a["outcome"], a["delay_ns"]) != (b["outcome"], b["delay_ns"]):
            n_different += 1
    return FateComparison(len(shared) - n_set_aside, n_different, n_set_aside, len(one.keys() ^ other.keys()))


def _fates(logs: RunLogs) -> dict[tuple[str, str, int], dict[str, Any]]:
    rows = logs.of("netem", FATES)
    return {(row["direction"], row["key"], row["seq"]): row for row in rows if not row["foreign"]}
