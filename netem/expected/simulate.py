"""A link's models at work on many packets at once, for statistics: loss, delay, copies and flips, without queues.

The very draws of the live path (`netem.stages.pipeline_draws`), under the very conditions
(`netem.conditions.conditions`); ordering and queueing depend on arrival times and stay out.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.channels import Direction
from common.scenario.network import NetworkPart
from common.streams import Address
from common.trace import Trace
from common.units import NS_PER_MS
from netem.conditions.conditions import Condition, Conditions
from netem.stages.impairment import Impairment, Modulations


class Simulated(NamedTuple):
    """N packets in the order of offering: arrays (N,). ``delay_ns`` is 0 where a packet is lost."""

    offered_ns: NDArray[np.int64]
    lost: NDArray[np.bool_]
    outage: NDArray[np.bool_]
    delay_ns: NDArray[np.int64]
    copy_delay_ns: NDArray[np.int64]
    n_flips: NDArray[np.int64]


def simulate(
    network: NetworkPart,
    direction: Direction,
    seed: int,
    offered_ns: NDArray[np.int64],
    n_bytes: int = 256,
    traces: Mapping[str, Trace] | None = None,
    key: str = "simulated",
) -> Simulated:
    """Return the fates of packets 0 .. N - 1 of one key that are offered at ``offered_ns`` (N,), ascending.

    ``lost`` holds those in an outage too. Oracle: `netem.link.link.Link`, packet by packet
    (tests/netem/expected/test_simulate).
    """
    conditions = Conditions.of(network, direction, seed)
    pipeline = network.forward if direction == "forward" else network.feedback
    impairment = Impairment(pipeline, Address(seed, direction, key), traces)
    n = len(offered_ns)
    which, found = _conditions_of(conditions, offered_ns)
    outage = np.array([condition.outage for condition in found], dtype=bool)[which]
    out = Simulated(
        offered_ns,
        outage.copy(),
        outage,
        np.zeros(n, dtype=np.int64),
        np.full(n, -1, dtype=np.int64),
        np.zeros(n, dtype=np.int64),
    )
    kinds = {condition.changes: k for k, condition in enumerate(found)}
    kind = np.array([kinds[condition.changes] for condition in found], dtype=np.int64)[which]
    for changes, k in kinds.items():
        seqs = np.flatnonzero((kind == k) & ~outage)
        here = which[seqs]
        modulations = Modulations(
            changes,
            np.array([condition.scale_delay for condition in found])[here],
            np.array([condition.add_delay_ns for condition in found], dtype=np.int64)[here],
            np.array([condition.p_extra_loss for condition in found])[here],
        )
        draws = impairment.decide_many(seqs, offered_ns[seqs] // NS_PER_MS, n_bytes, modulations)
        for column, drawn in zip((out.lost, out.delay_ns, out.copy_delay_ns, out.n_flips), draws, strict=True):
            column[seqs] = drawn
    out.delay_ns[out.lost] = 0
    return out


def _conditions_of(
    conditions: Conditions, offered_ns: NDArray[np.int64]
) -> tuple[NDArray[np.int64], list[Condition]]:
    """Return which condition holds for each packet, (N,), and the conditions met, in order."""
    which = np.zeros(len(offered_ns), dtype=np.int64)
    found: list[Condition] = []
    first = 0
    while first < len(offered_ns):
        condition = conditions.at(int(offered_ns[first]))
        stop = int(np.searchsorted(offered_ns, condition.until_ns))
        which[first:stop] = len(found)
        found.append(condition)
        first = stop
    return which, found
