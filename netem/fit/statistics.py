"""Statistics of delays and losses by which a record is compared with replays of a fit."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.loss import loss_runs
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.draws.blocks import Floats

LAGS_S: Final = (0.1, 1.0, 10.0)
PERCENTS: Final = (5, 50, 95, 99)
_HIGH_LOSS: Final = 0.2
_MIN_PAIRS: Final = 30
_NEAR: Final = 2
_RESOLVED_MS: Final = 1e-6
LOSS: Final = "loss, %"
MEAN: Final = "mean delay, ms"
QUANTILES: Final = tuple(f"p{q}, ms" for q in PERCENTS)
BESIDE: Final = "delay beside losses, ms"
LONGEST: Final = "longest run of losses"
HIGH: Final = "seconds above 20 % loss"
AUTOCORRELATIONS: Final = tuple(f"autocorrelation at {lag:g} s" for lag in LAGS_S)
NAMES: Final = (LOSS, MEAN, *QUANTILES, *AUTOCORRELATIONS, BESIDE, LONGEST, HIGH)
CENTRES: Final = frozenset((LOSS, MEAN, *QUANTILES))
"""Loss, mean and quantiles, which count as reproduced within 10 %; the others vary from record to record."""


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
        return np.array([100.0] + [np.nan] * (len(NAMES) - 3) + [float(len(lost)), seconds_of_loss(sent_ns, lost)])
    return np.array(
        [
            100 * float(lost.mean()),
            float(arrived.mean()),
            *np.percentile(arrived, PERCENTS),
            *(_autocorrelation(sent_ns, delay_ms, lag) for lag in LAGS_S),
            _beside(delay_ms, lost),
            float(loss_runs(lost).longest),
            seconds_of_loss(sent_ns, lost),
        ]
    )


def pairs_apart(
    sent_ns: NDArray[np.int64], delay_ms: Floats, lag_s: float
) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the places of messages that arrived and of those that arrived a lag after them; none at a short lag."""
    none = np.empty(0, dtype=np.intp)
    intervals_ns = np.diff(sent_ns)
    half_ns = float(np.median(intervals_ns)) / 2 if len(intervals_ns) else 0.0
    if half_ns * 2 > lag_s * NS_PER_S * 1.25:  # the messages are too rare for this lag
        return none, none
    later = np.searchsorted(sent_ns, sent_ns + (lag_s * NS_PER_S - half_ns))
    there = np.flatnonzero(later < len(sent_ns))
    first, second = there, later[there]
    near = sent_ns[second] - sent_ns[first] <= lag_s * NS_PER_S + half_ns
    both = near & ~np.isnan(delay_ms[first]) & ~np.isnan(delay_ms[second])
    return first[both], second[both]


def _autocorrelation(sent_ns: NDArray[np.int64], delay_ms: Floats, lag_s: float) -> float:
    first, second = pairs_apart(sent_ns, delay_ms, lag_s)
    x, y = delay_ms[first], delay_ms[second]
    if len(x) < _MIN_PAIRS or min(x.std(), y.std()) < _RESOLVED_MS:
        return float("nan")
    return float(np.mean((x - x.mean()) * (y - y.mean())) / (x.std() * y.std()))


def _beside(delay_ms: Floats, lost: NDArray[np.bool_]) -> float:
    near = beside_losses(lost)
    return float(delay_ms[near].mean()) if near.any() else float("nan")


def beside_losses(lost: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which messages, (N,), arrived among the two on either side of a run of losses."""
    near = lost.copy()
    for step in range(1, _NEAR + 1):
        near[step:] |= lost[:-step]
        near[:-step] |= lost[step:]
    return near & ~lost


def seconds_of_loss(sent_ns: NDArray[np.int64], lost: NDArray[np.bool_]) -> float:
    """Return in how many seconds of N messages more than a fifth was lost."""
    second = (sent_ns - sent_ns[0]) // NS_PER_S
    _, which = np.unique(second, return_inverse=True)
    return float(np.count_nonzero(np.bincount(which, lost) > _HIGH_LOSS * np.bincount(which)))
