"""Losses of a stream of packets: their runs, the interval of their share, and Gilbert's model fitted to them.

A two-state chain with the states received and lost (Gilbert 1960) describes the losses by two transition
probabilities: p to lost and r to received; the share of losses is p / (p + r), the mean run 1 / r. Intervals allow
for bursts. Runs are the loss patterns of RFC 3357.
"""

from math import sqrt
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray


class LossRuns(NamedTuple):
    """The losses of N packets in the order of sending. A run is a *loss period* of the RFC."""

    n: int
    n_lost: int
    lengths: NDArray[np.int64]
    """(n_runs,): packets in each run, in order; the first and the last may be cut by the record's ends."""
    distances: NDArray[np.int64]
    """(n_lost - 1,): from each loss to the next one, in packets; 1 within a run (*loss distance*)."""

    @property
    def n_runs(self) -> int:
        """Return the number of runs."""
        return len(self.lengths)

    @property
    def mean_burst(self) -> float | None:
        """Return the mean length of the runs; None without losses."""
        return self.n_lost / self.n_runs if self.n_runs else None

    @property
    def longest(self) -> int:
        """Return the length of the longest run; 0 without losses."""
        return int(self.lengths.max(initial=0))


def loss_runs(lost: NDArray[np.bool_]) -> LossRuns:
    """Return the runs of ``lost``, (N,), in the order of sending (oracle: itertools.groupby, test_loss)."""
    edges = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=0, append=0))
    begins, ends = edges[::2], edges[1::2]
    at = np.flatnonzero(lost)
    return LossRuns(len(lost), len(at), ends - begins, np.diff(at))


def wilson_interval(n_lost: float, n: float, confidence: float = 0.95) -> tuple[float, float] | None:
    """Return the Wilson score interval of a loss share, (low, high) in 0..1; None without packets.

    Unlike the normal approximation it stays within 0..1 and has a width at no loss (Wilson 1927). It assumes
    independent losses; bursts make the true interval wider. Oracle: `scipy.stats.binomtest`.
    """
    if n == 0:
        return None
    # Centre and half width of the interval before the common factor 1 / (1 + z^2 / n).
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    share = n_lost / n
    centre = share + z * z / (2 * n)
    half = z * sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    scale = 1 + z * z / n
    # Without losses the bound is exactly 0, with losses only exactly 1; rounding would leave -1e-18.
    low = (centre - half) / scale if n_lost > 0 else 0.0
    high = (centre + half) / scale if n_lost < n else 1.0
    return (low, high)


Interval = tuple[float, float]

_MIN_BATCHED: Final = 400  # 11 batches of 36


class _Steps(NamedTuple):
    """Counts of pairs of successive packets, by the states of both."""

    n_received: int
    n_received_lost: int
    n_lost: int
    n_lost_received: int


class GilbertFit(NamedTuple):
    """Gilbert's model of a stream; None where the record does not determine a parameter."""

    p_loss: float
    p_loss_interval: Interval
    mean_burst: float | None
    mean_burst_interval: Interval | None
    p_bad: float | None
    p_good: float | None


def fit_gilbert(lost: NDArray[np.bool_]) -> GilbertFit:
    """Return the most likely model of ``lost``, (N,), N > 0, in the order of sending; raises ValueError when empty.

    ``p_bad`` (p) and ``p_good`` (r) are the observed shares of transitions, the maximum-likelihood estimates.
    ``mean_burst`` is 1 / r, so that a run cut off by the record's end does not bias it. Each lost packet ends its run
    with probability r, so the interval of r is Wilson's, for fewer packets where run lengths vary more than geometric
    ones, and that of the mean run is its inverse; it is open (inf) if no run ends in the record. Oracle: known chains
    and coverage in simulations, test_loss.
    """
    if len(lost) == 0:
        raise ValueError("lost must have at least one packet")
    steps = _steps(lost)
    r = steps.n_lost_received / steps.n_lost if steps.n_lost else None
    # The mean run is 1 / r, so the ends of the interval of r, inverted, are those of the mean run.
    inflation = _inflation_of_lengths(lost, r) if r else 1.0
    ends = wilson_interval(steps.n_lost_received / inflation, steps.n_lost / inflation)
    return GilbertFit(
        p_loss=float(lost.mean()),
        p_loss_interval=loss_interval(lost),
        mean_burst=1.0 / r if r else None,
        mean_burst_interval=(1.0 / ends[1], 1.0 / ends[0] if ends[0] > 0 else float("inf")) if ends else None,
        p_bad=steps.n_received_lost / steps.n_received if steps.n_received else None,
        p_good=r,
    )


def loss_interval(lost: NDArray[np.bool_]) -> Interval:
    """Return the 95 % interval of the share of losses, (low, high) in 0..1, widened for bursts.

    It is Wilson's with N / f independent packets, f the larger of two inflations of the variance of a mean: that of
    Gilbert's model, (1 + rho) / (1 - rho), rho = 1 - p - r the correlation of neighbours; and, from 400 packets on,
    that of batches of N ** 0.6 packets, which includes runs that Gilbert's model does not explain (heavy tails, bad
    states that lose only some packets). Negative correlation does not narrow the interval; f is 1 where no packet or
    every packet is lost. Oracle: coverage in simulations, test_loss. Raises ValueError when ``lost``, (N,), is
    empty.
    """
    n, n_lost = len(lost), int(np.count_nonzero(lost))
    if n == 0:
        raise ValueError("lost must have at least one packet")
    inflation = max(_inflation_of_steps(_steps(lost)), _inflation_of_batches(lost)) if 0 < n_lost < n else 1.0
    interval = wilson_interval(n_lost / inflation, n / inflation)
    assert interval is not None
    return interval


def _inflation_of_lengths(lost: NDArray[np.bool_], r: float) -> float:
    lengths = loss_runs(lost).lengths
    geometric = (1.0 - r) / r**2  # variance of a geometric run length with end probability r
    return max(1.0, float(lengths.var(ddof=1)) / geometric) if len(lengths) > 1 and geometric > 0 else 1.0


def _inflation_of_steps(steps: _Steps) -> float:
    # Half a transition is added on each side, so that rho stays below 1 when no run ends in the record.
    p = (steps.n_received_lost + 0.5) / (steps.n_received + 1)
    r = (steps.n_lost_received + 0.5) / (steps.n_lost + 1)
    rho = max(0.0, 1.0 - p - r)
    return (1.0 + rho) / (1.0 - rho)


def _inflation_of_batches(lost: NDArray[np.bool_]) -> float:
    if len(lost) < _MIN_BATCHED:
        return 1.0
    size = int(len(lost) ** 0.6)
    used = lost[: len(lost) // size * size]
    share = float(used.mean())
    independent = share * (1.0 - share) / size
    return float(used.reshape(-1, size).mean(axis=1).var(ddof=1)) / independent if independent > 0 else 1.0


def _steps(lost: NDArray[np.bool_]) -> _Steps:
    now, following = lost[:-1], lost[1:]
    n_lost = int(np.count_nonzero(now))
    return _Steps(
        n_received=len(now) - n_lost,
        n_received_lost=int(np.count_nonzero(~now & following)),
        n_lost=n_lost,
        n_lost_received=int(np.count_nonzero(now & ~following)),
    )
