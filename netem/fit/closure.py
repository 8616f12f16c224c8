"""Replays of a fit: the fitted network is simulated at the record's send times, and its statistics are compared."""

from collections.abc import Mapping
from math import inf, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.loss import loss_runs
from tis.common.scenario.network import NetworkPart
from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.build import build_links
from tis.netem.conditions.conditions import Conditions
from tis.netem.draws.blocks import Floats
from tis.netem.expected.simulate import simulate
from tis.netem.fit.backlogs import MESSAGE_BYTES

TOLERANCE: Final = 0.1
MIDDLE: Final = (2.5, 97.5)
_NEVER_NS: Final = 2**62
_FEW: Final = 2.0
"""Standard errors of the replays' mean that are added to the tolerance."""

LAGS_S: Final = (0.1, 1.0, 10.0)
_QUANTILES: Final = (5, 50, 95, 99)
_HIGH_LOSS: Final = 0.2
_MIN_PAIRS: Final = 30
_NEAR: Final = 2
_RESOLVED_MS: Final = 1e-6
LOSS: Final = "loss, %"
MEAN: Final = "mean delay, ms"
QUANTILES: Final = tuple(f"p{q}, ms" for q in _QUANTILES)
BESIDE: Final = "delay beside losses, ms"
LONGEST: Final = "longest run of losses"
HIGH: Final = "seconds above 20 % loss"
AUTOCORRELATIONS: Final = tuple(f"autocorrelation at {lag:g} s" for lag in LAGS_S)
NAMES: Final = (LOSS, MEAN, *QUANTILES, *AUTOCORRELATIONS, BESIDE, LONGEST, HIGH)
CENTRES: Final = frozenset((LOSS, MEAN, *QUANTILES))
"""Mean and quantiles, which a replay must reproduce to 10 %; the others vary from replay to replay."""


class Closure(NamedTuple):
    """One statistic of the record and of its replays: their mean, and the ends of their middle 95 %.

    ``closes``: a mean or a quantile of the record is within 10 % of the replays' mean, as far as two standard errors
    of that mean can tell; any other statistic is within the middle 95 %. ``severity`` is the miss in units of what is
    allowed, above 1 where it does not close.
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
    for name, record, values in zip(NAMES, statistics_of(trace.sent_ns, trace.delay_ns), replayed.T, strict=True):
        of = values[~np.isnan(values)]
        if np.isnan(record) or not len(of):
            continue
        low, high = np.percentile(of, MIDDLE)
        severity = _severity(name, float(record), of)
        found.append(Closure(name, float(record), float(of.mean()), float(low), float(high), severity))
    return tuple(found)


def _severity(name: str, record: float, of: Floats) -> float:
    mean = float(of.mean())
    if name in CENTRES:
        allowed = TOLERANCE * abs(record) + _FEW * float(of.std()) / sqrt(len(of))
        return 0.0 if record == mean else abs(record - mean) / allowed if allowed > 0 else inf
    low, middle, high = np.percentile(of, [MIDDLE[0], 50, MIDDLE[1]])
    if low <= record <= high:
        side = high - middle if record > middle else middle - low
        return float(abs(record - middle) / side) if side > 0 else 0.0
    side = high - middle if record > high else middle - low
    beyond = record - high if record > high else low - record
    return 1.0 + float(beyond) / max(float(side), 0.02 * abs(record), 1e-9)


def statistics_of(sent_ns: NDArray[np.int64], delay_ns: NDArray[np.int64]) -> Floats:
    """Return the statistics `NAMES` of N messages, nan where they are not defined.

    Parameters
    ----------
    sent_ns
        (N,), not descending.
    delay_ns
        (N,), negative where lost.

    Notes
    -----
    The autocorrelation is that of the delays of messages that arrived, each with the message sent nearest to the lag
    after it. Beside losses are the two messages on either side of a run. Oracle: values by hand and numpy's
    `corrcoef`, tests/netem/fit/test_statistics.
    """
    lost = delay_ns < 0
    delay_ms = np.where(lost, np.nan, delay_ns / NS_PER_MS)
    arrived = delay_ms[~lost]
    if not len(arrived):
        return np.array([100.0] + [np.nan] * (len(NAMES) - 3) + [float(len(lost)), _seconds_of_loss(sent_ns, lost)])
    return np.array(
        [
            100 * float(lost.mean()),
            float(arrived.mean()),
            *np.percentile(arrived, _QUANTILES),
            *(_autocorrelation(sent_ns, delay_ms, lag) for lag in LAGS_S),
            _beside(delay_ms, lost),
            float(loss_runs(lost).longest),
            _seconds_of_loss(sent_ns, lost),
        ]
    )


def _autocorrelation(sent_ns: NDArray[np.int64], delay_ms: Floats, lag_s: float) -> float:
    intervals_ns = np.diff(sent_ns)
    half_ns = float(np.median(intervals_ns)) / 2 if len(intervals_ns) else 0.0
    if half_ns * 2 > lag_s * NS_PER_S * 1.25:  # the messages are too rare for this lag
        return float("nan")
    later = np.searchsorted(sent_ns, sent_ns + (lag_s * NS_PER_S - half_ns))
    there = np.flatnonzero(later < len(sent_ns))
    x, y = delay_ms[there], delay_ms[later[there]]
    near = sent_ns[later[there]] - sent_ns[there] <= lag_s * NS_PER_S + half_ns
    both = near & ~np.isnan(x) & ~np.isnan(y)
    x, y = x[both], y[both]
    if len(x) < _MIN_PAIRS or min(x.std(), y.std()) < _RESOLVED_MS:
        return float("nan")
    return float(np.mean((x - x.mean()) * (y - y.mean())) / (x.std() * y.std()))


def _beside(delay_ms: Floats, lost: NDArray[np.bool_]) -> float:
    near = lost.copy()
    for step in range(1, _NEAR + 1):
        near[step:] |= lost[:-step]
        near[:-step] |= lost[step:]
    near &= ~lost
    return float(delay_ms[near].mean()) if near.any() else float("nan")


def _seconds_of_loss(sent_ns: NDArray[np.int64], lost: NDArray[np.bool_]) -> float:
    second = (sent_ns - sent_ns[0]) // NS_PER_S
    _, which = np.unique(second, return_inverse=True)
    return float(np.count_nonzero(np.bincount(which, lost) > _HIGH_LOSS * np.bincount(which)))
