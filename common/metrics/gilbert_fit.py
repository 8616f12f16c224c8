"""Gilbert's model fitted to the losses of a stream, with confidence intervals that allow for bursts.

A two-state chain with the states received and lost (Gilbert 1960) describes the losses by two transition
probabilities: p to lost and r to received; the share of losses is p / (p + r), the mean run 1 / r.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.loss import wilson_interval
from tis.common.metrics.loss_runs import loss_runs

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
    and coverage in simulations, test_gilbert_fit.
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
    every packet is lost. Oracle: coverage in simulations, test_gilbert_fit. Raises ValueError when ``lost``, (N,), is
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
