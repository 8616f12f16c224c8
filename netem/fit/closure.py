"""Replays of a fit: the fitted network is simulated at the record's send times, and its statistics are compared."""

from collections.abc import Mapping
from math import inf
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network import NetworkPart
from tis.common.trace import LOST, Trace
from tis.netem.build import build_links
from tis.netem.conditions.conditions import Conditions
from tis.netem.draws.blocks import Floats
from tis.netem.expected.simulate import simulate
from tis.netem.fit.backlogs import MESSAGE_BYTES
from tis.netem.fit.prediction import between_shares, half_widths, interval, resampled, scaled
from tis.netem.fit.statistics import CENTRES, NAMES, statistics_of

_TOLERANCE: Final = 0.1
_WITHIN: Final = 0.85
_NEVER_NS: Final = 2**62


class Closure(NamedTuple):
    """One statistic of the record, the mean of its replays, and the ends of its prediction interval.

    Of further records of the network, of the same length, 95 of 100 are expected in the interval. ``closes``: so are
    85 of 100 replays, or, of a mean or quantile, the replays' mean is within 10 % of the record. ``severity`` is the
    miss in units of what is allowed, above 1 where it does not close.

    With normal statistics the interval reaches 2.33 sqrt 2 = 3.29 standard deviations from the record. Of two equal
    networks 85 of 100 replays lie in it as long as the record is within 2.25 deviations of the mean: in 97 of 100
    records.
    """

    name: str
    record: float
    mean: float
    low: float
    high: float
    severity: float

    @property
    def closes(self) -> bool:
        """Tell whether the replays reproduce the record's statistic."""
        return self.severity <= 1.0


def replay(network: NetworkPart, trace: Trace, seed: int, ordered: bool) -> NDArray[np.int64]:
    """Return the delays, (N,), of the forward direction at a record's send times, `LOST` where lost.

    ``ordered``: a message waits for, or is dropped behind, those that left before it, as the pipeline's ordering
    says; a log of decided delays has them before ordering.
    """
    sent_ns = trace.sent_ns - trace.sent_ns[0]
    if network.forward.rate is not None:
        return _through_queue(network, sent_ns, seed)
    fates = simulate(network, "forward", seed, sent_ns)
    arrived = ~fates.lost
    delay_ns = np.where(arrived, fates.delay_ns + _waits_ns(network, sent_ns, seed), LOST)
    ordering = network.forward.ordering
    if not ordered or ordering == "reorder":
        return delay_ns
    leaves_ns = sent_ns + delay_ns
    if ordering == "fifo":
        return np.where(arrived, np.maximum.accumulate(np.where(arrived, leaves_ns, 0)) - sent_ns, LOST)
    after_ns = np.where(arrived, leaves_ns, _NEVER_NS)[::-1]
    return np.where(arrived & (leaves_ns <= np.minimum.accumulate(after_ns)[::-1]), delay_ns, LOST)


def _waits_ns(network: NetworkPart, sent_ns: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """Return how long each message, (N,), waits for the end of a stall."""
    wait_ns = np.zeros(len(sent_ns), dtype=np.int64)
    if not any(process.effect == "stall" for process in network.outages):
        return wait_ns
    conditions, at_ns = Conditions.of(network, "forward", seed), 0
    while at_ns <= sent_ns[-1]:
        begin_ns = end_ns = at_ns
        while conditions.at(end_ns).stall:
            end_ns = conditions.at(end_ns).until_ns
        if end_ns > begin_ns:
            within = slice(*np.searchsorted(sent_ns, (begin_ns, end_ns)))
            wait_ns[within] = end_ns - sent_ns[within]
        at_ns = conditions.at(end_ns).until_ns
    return wait_ns


def _through_queue(network: NetworkPart, sent_ns: NDArray[np.int64], seed: int) -> NDArray[np.int64]:
    """Return the delays, (N,), of messages that pass the queue of a rate, one by one."""
    link = build_links(network, ["replayed"], seed, None, "replay")["forward"]
    delay_ns = np.full(len(sent_ns), LOST, dtype=np.int64)

    def leave(now_ns: int) -> None:
        for due in link.release(now_ns):
            if due.departure == "released" and due.copy_index == 0:
                delay_ns[due.item] = (due.release_ns or 0) - due.offered_ns

    for number, now_ns in enumerate(sent_ns.tolist()):
        leave(now_ns)
        link.offer("replayed", b"", MESSAGE_BYTES, now_ns, number)
    leave(_NEVER_NS)
    return delay_ns


def replays(network: Mapping[str, Any], trace: Trace, n: int, ordered: bool) -> Floats:
    """Return the statistics of ``n`` replays with the seeds 1 .. n, (n, statistics)."""
    model = NetworkPart.model_validate(network)
    return np.array([statistics_of(trace.sent_ns, replay(model, trace, seed, ordered)) for seed in range(1, n + 1)])


def closures(trace: Trace, replayed: Floats) -> tuple[Closure, ...]:
    """Compare a record with its replays, (n, statistics); statistics that the record does not have are left out.

    Oracle: values by hand, tests/netem/fit/test_closure.
    """
    found = []
    of_record = statistics_of(trace.sent_ns, trace.delay_ns)
    reaches = half_widths(of_record, resampled(trace), replayed, len(trace.sent_ns))
    shares = between_shares(trace)
    for number, (name, record, values) in enumerate(zip(NAMES, of_record, replayed.T, strict=True)):
        of = values[~np.isnan(values)]
        if np.isnan(record) or not len(of):
            continue
        low, high = interval(name, float(record), float(reaches[number]))
        lower, upper = shares.get(name, (low, high))
        low, high = min(low, lower), max(high, upper)
        away = np.abs(scaled(name, of) - scaled(name, record))
        severity = _ratio(float(np.quantile(away, _WITHIN)), float(reaches[number]))
        mean = float(of.mean())
        if name in CENTRES:
            severity = min(severity, _ratio(abs(float(record) - mean), _TOLERANCE * abs(float(record))))
        found.append(Closure(name, float(record), mean, low, high, severity))
    return tuple(found)


def _ratio(miss: float, allowed: float) -> float:
    return 0.0 if miss == 0 else miss / allowed if allowed > 0 else inf
