"""Vectorised simulation of a link's models, for statistics: loss, delay, copies and flips, without queues.

It has the draws of the live path (`tis.netem.stages.pipeline_draws`) under the same conditions
(`tis.netem.conditions.conditions`). Queueing depends on arrival times and is left out; a recovery of lost packets is
followed packet by packet. What ordering adds to the delays is told for one rate of packets (`in_order`).
"""

from collections.abc import Callable, Mapping
from math import isnan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.channels import Direction
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.conditions.conditions import FOREVER_NS, Condition, Conditions
from tis.netem.expected.figures import DirectionFigures
from tis.netem.stages.impairment import Impairment, Modulations
from tis.netem.stages.loss.recovery import Connection

IN_ORDER_HZ: Final = 60
"""Packets per second of `in_order`."""

_N_IN_ORDER: Final = 18_000  # five minutes


class Simulated(NamedTuple):
    """N packets in the order of offering: arrays (N,). ``delay_ns`` is 0 for a lost packet.

    With a recovery ``recovered`` packets are repeated, and ``delay_ns`` has all that this takes.
    """

    offered_ns: NDArray[np.int64]
    lost: NDArray[np.bool_]
    outage: NDArray[np.bool_]
    delay_ns: NDArray[np.int64]
    copy_delay_ns: NDArray[np.int64]
    n_flips: NDArray[np.int64]
    recovered: NDArray[np.bool_]


def simulate(
    network: NetworkPart,
    direction: Direction,
    seed: int,
    offered_ns: NDArray[np.int64],
    n_bytes: int = 256,
    traces: Mapping[str, Trace] | None = None,
    key: str = "simulated",
) -> Simulated:
    """Return the fates of packets 0 .. N - 1 of one key.

    Parameters
    ----------
    network, direction, seed
        A scenario's network, ``forward`` or ``feedback``, and the seed of every random number.
    offered_ns
        (N,) instants of offering, in ns of run time, ascending.
    n_bytes
        Length of each payload.
    traces
        Recorded networks, by the paths that the network names.
    key
        The key of the packets, which addresses their random numbers.

    Returns
    -------
    Simulated
        Arrays (N,); ``lost`` includes the packets in an outage, ``copy_delay_ns`` is -1 without a copy.

    Notes
    -----
    Oracle: `tis.netem.link.link.Link`, packet by packet, tests/netem/expected/test_simulate.

    Examples
    --------
    >>> network = NetworkPart.model_validate({"forward": {"delay": {"kind": "constant", "delay_ms": 40}}})
    >>> simulate(network, "forward", seed=7, offered_ns=np.arange(3) * 1_000_000).delay_ns.tolist()
    [40000000, 40000000, 40000000]
    """
    # Stage 1: the condition of each packet; outages need no draw.
    which, found = _conditions_of(Conditions.of(network, direction, seed), offered_ns)
    outage = np.array([condition.outage for condition in found], dtype=bool)[which]
    delay_ns, copy_ns, n_flips = (np.full(len(offered_ns), value, dtype=np.int64) for value in (0, -1, 0))
    out = Simulated(offered_ns, outage.copy(), outage, delay_ns, copy_ns, n_flips, np.zeros_like(outage))
    # Stage 2: the draws, grouped by replaced stages, since each group has a pipeline of its own.
    pipeline = network.forward if direction == "forward" else network.feedback
    impairment = Impairment(pipeline, Address(seed, direction, key), traces)
    if any(impairment.variant(condition.changes).terms for condition in found):
        _recover(impairment, Conditions.of(network, direction, seed), out, n_bytes)
        return out
    groups = {condition.changes: number for number, condition in enumerate(found)}
    group = np.array([groups[condition.changes] for condition in found], dtype=np.int64)[which]
    for changes, number in groups.items():
        seqs = np.flatnonzero((group == number) & ~outage)
        modulations = _modulations(changes, found, which[seqs])
        draws = impairment.decide_many(seqs, offered_ns[seqs] // NS_PER_MS, n_bytes, modulations)
        for column, drawn in zip((out.lost, delay_ns, copy_ns, n_flips), draws, strict=True):
            column[seqs] = drawn
    out.delay_ns[out.lost] = 0
    return out


def in_order(
    network: NetworkPart, direction: Direction, drawn: DirectionFigures, traces: Mapping[str, Trace] | None = None
) -> DirectionFigures:
    """Return a direction's figures with the delays that packets have which keep the pipeline's order.

    ``drawn`` are the figures without order. What order adds at `IN_ORDER_HZ` packets a second is taken from the same
    simulated packets with and without it, so that the chance of a slow state or correlation cancels. Of ``drop_late``
    the delays are those of packets that are not dropped. Oracle: the product of the distribution function over all
    earlier packets, and `tis.netem.link.link.Link`, tests/netem/expected/test_simulate.
    """
    ordering = getattr(network, direction).ordering
    if ordering == "reorder" or isnan(drawn.mean_ms):
        return drawn
    sent_ns = np.arange(_N_IN_ORDER, dtype=np.int64) * NS_PER_S // IN_ORDER_HZ
    found = simulate(network, direction, 0, sent_ns, traces=traces)
    arrives = ~found.lost
    if not arrives.any():
        return drawn
    due_ns = (sent_ns + found.delay_ns)[arrives]
    alone_ms = found.delay_ns[arrives] / NS_PER_MS
    if ordering == "fifo":
        kept_ms = (np.maximum.accumulate(due_ns) - sent_ns[arrives]) / NS_PER_MS
    else:
        kept_ms = alone_ms[due_ns == np.minimum.accumulate(due_ns[::-1])[::-1]]

    def added(of: Callable[[NDArray[np.float64]], np.floating]) -> float:
        return float(of(kept_ms) - of(alone_ms))

    return drawn._replace(
        mean_ms=drawn.mean_ms + added(np.mean),
        std_ms=drawn.std_ms + added(np.std),
        p50_ms=drawn.p50_ms + added(lambda ms: np.quantile(ms, 0.5)),
        p99_ms=drawn.p99_ms + added(lambda ms: np.quantile(ms, 0.99)),
    )


def _recover(impairment: Impairment, conditions: Conditions, out: Simulated, n_bytes: int) -> None:
    """Fill in the fates of packets of a connection that repeats what is lost, one by one."""
    sent_ns = out.offered_ns.tolist()
    ways = Connection(lambda seq, n, at_ns: impairment.leaves_again_ns(seq, n, at_ns, conditions))

    def arrive(until_ns: int) -> None:
        for seq, from_ns, due_ns in ways.advance(until_ns):
            out.delay_ns[seq] = due_ns - from_ns

    for seq, now_ns in enumerate(sent_ns):
        arrive(now_ns)
        draw = impairment.decide(seq, now_ns, n_bytes, conditions.at(now_ns))
        out.lost[seq] = isinstance(draw, str)
        if isinstance(draw, str):
            continue
        out.outage[seq] &= not draw.is_lost
        out.recovered[seq], out.n_flips[seq] = draw.is_lost, draw.n_flips
        out.delay_ns[seq] = draw.delay_ns
        if draw.copy_delay_ns is not None:
            out.copy_delay_ns[seq] = draw.copy_delay_ns
        if impairment.terms is not None:
            due_ns = ways.send(seq, now_ns, draw.delay_ns, n_bytes, draw.is_lost, impairment.terms)
            out.delay_ns[seq] = 0 if due_ns is None else due_ns - now_ns
    while (next_ns := ways.next_ns()) is not None and next_ns < FOREVER_NS:
        arrive(next_ns)


def _modulations(changes: tuple[Change, ...], found: list[Condition], which: NDArray[np.int64]) -> Modulations:
    return Modulations(
        changes,
        np.array([condition.scale_delay for condition in found])[which],
        np.array([condition.add_delay_ns for condition in found], dtype=np.int64)[which],
        np.array([condition.p_extra_loss for condition in found])[which],
    )


def _conditions_of(
    conditions: Conditions, offered_ns: NDArray[np.int64]
) -> tuple[NDArray[np.int64], list[Condition]]:
    """Return the index of each packet's condition, (N,), and the conditions, in order."""
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
