"""Prediction intervals of a record's statistics, in which a further record of the same network is expected.

Two records of one network differ by the difference of two independent draws of a statistic. How far such draws lie
apart is taken from the record itself, whose tenths are drawn anew with replacement (the block bootstrap; Kunsch, "The
jackknife and the bootstrap for general stationary observations", 1989), and from pairs of replays of the fitted
network. The larger counts; of the replays at most twice the other, since a model may spread too far. Extremes, such
as the longest run of losses, are not seen in tenths: there the replays count in full. One record may itself be an
unusual one: for 95 of 100 further records of it, too, the distance that 98 of 100 pairs do not exceed is taken.

Where few events decide about a quantile, or it lies between two regimes, the record's parts may agree by chance. So
its interval also has the quantiles at the shares that smaller delays are expected to have (Woodruff, "Confidence
intervals for medians and other position measures", 1952).
"""

from math import ceil, floor, sqrt
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.metrics.loss import loss_runs
from tis.common.streams import Stream
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Floats
from tis.netem.fit.statistics import (
    AUTOCORRELATIONS,
    HIGH,
    LAGS_S,
    LONGEST,
    LOSS,
    NAMES,
    PERCENTS,
    QUANTILES,
    beside_losses,
    pairs_apart,
    seconds_of_loss,
)

_PARTS: Final = 10
_DRAWS: Final = 200
_LEVEL: Final = 0.98
_BINS: Final = 4000
_MOST: Final = 2.0
_NONE_OF: Final = 3  # what occurs three times in a record on average is missing in one of twenty
_COUNTS: Final = (LOSS, LONGEST, HIGH)
_EXTREMES: Final = (LONGEST, HIGH)
_EDGE: Final = 1e-3
_TINY: Final = 1e-9
_T, _NORMAL = (float(law.ppf((1 + _LEVEL) / 2)) for law in (scipy.stats.t(_PARTS - 1), scipy.stats.norm))
_FEW_PARTS: Final = _T / _NORMAL * sqrt(_PARTS / (_PARTS - 1))
"""Few parts say little of their spread: Student's quantile instead of the normal one, and n - 1 instead of n."""


def scaled(name: str, values: Floats | float) -> Floats:
    """Return a statistic on a scale on which its spread does not depend on it: Fisher's z, root or logarithm."""
    of = np.asarray(values, dtype=np.float64)
    if name in AUTOCORRELATIONS:
        return np.arctanh(np.clip(of, _EDGE - 1, 1 - _EDGE))
    return np.sqrt(of) if name in _COUNTS else np.log(np.maximum(of, _TINY))


def interval(name: str, record: float, reach: float) -> tuple[float, float]:
    """Return the ends of an interval about a record's statistic, ``reach`` on the scale of `scaled` either side."""
    middle = float(scaled(name, record))
    if name in AUTOCORRELATIONS:
        return float(np.tanh(middle - reach)), float(np.tanh(middle + reach))
    if name in _COUNTS:
        low, high = max(0.0, middle - reach) ** 2, (middle + reach) ** 2
        return (float(floor(low)), float(ceil(high))) if name in _EXTREMES else (low, high)
    return float(np.exp(middle - reach)), float(np.exp(middle + reach))


def half_widths(record: Floats, drawn: Floats, replayed: Floats, n: int) -> Floats:
    """Return how far a further record is expected to lie from this one, (statistics,), on the scale of `scaled`.

    Parameters
    ----------
    record
        (statistics,) of the record.
    drawn, replayed
        (k, statistics) of records made of its parts, and of replays of its fit; nan where they have none.
    n
        Number of the record's messages.
    """
    found = np.zeros(len(NAMES))
    for number, name in enumerate(NAMES):
        own = _FEW_PARTS * _apart(scaled(name, drawn[:, number]))
        models = _apart(scaled(name, replayed[:, number]))
        if name not in _EXTREMES and own > 0:
            models = min(models, _MOST * own)
        found[number] = max(own, models, 0.0 if record[number] else _never(name, n))
    return found


def between_shares(trace: Trace) -> dict[str, tuple[float, float]]:
    """Return for each quantile the delays, in ms, at the shares that further records may have below it.

    Oracle: shares by hand, tests/netem/fit/test_prediction.
    """
    arrived = trace.delay_ns >= 0
    if not arrived.any():
        return {}
    part, delay_ms = _parts(trace)[arrived], trace.delay_ns[arrived] / NS_PER_MS
    found = {}
    for name, percent in zip(QUANTILES, PERCENTS, strict=True):
        below = delay_ms <= np.quantile(delay_ms, percent / 100)
        away = np.bincount(part, below - below.mean(), _PARTS)
        reach = _T * sqrt(2 * _PARTS / (_PARTS - 1) * float(np.sum(away**2))) / len(delay_ms)
        low, high = np.quantile(delay_ms, np.clip((percent / 100 - reach, percent / 100 + reach), 0.0, 1.0))
        found[name] = (float(low), float(high))
    return found


def _parts(trace: Trace) -> NDArray[np.int64]:
    """Return the tenth of the record in which each message, (N,), was sent."""
    sent_ns = trace.sent_ns - trace.sent_ns[0]
    return np.asarray(np.minimum(sent_ns * _PARTS // max(int(sent_ns[-1]), 1), _PARTS - 1))


def _never(name: str, n: int) -> float:
    """Return how far what never occurred among n messages may still be: three losses, one run, one second."""
    return sqrt(100 * _NONE_OF / n) if name == LOSS else 1.0 if name in _EXTREMES else 0.0


def _apart(values: Floats) -> float:
    """Return the distance that 98 of 100 pairs of values do not exceed, of those that are numbers."""
    known = values[np.isfinite(values)]
    if len(known) < 2:
        return 0.0
    first, second = np.triu_indices(len(known), 1)
    return float(np.quantile(np.abs(known[first] - known[second]), _LEVEL))


def resampled(trace: Trace, n: int = _DRAWS) -> Floats:
    """Return the statistics of ``n`` records made of tenths of this one, drawn with replacement, (n, statistics).

    Oracle: the tenths put together message by message, tests/netem/fit/test_prediction.
    """
    sent_ns, lost = trace.sent_ns - trace.sent_ns[0], trace.delay_ns < 0
    part = _parts(trace)
    drawn = (Stream.named(0, "fit/tenths").uniforms(0, n * _PARTS) * _PARTS).astype(np.int64).reshape(n, _PARTS)
    times = (drawn[:, :, None] == np.arange(_PARTS)).sum(axis=1).astype(np.float64)
    delay_ms = np.where(lost, np.nan, trace.delay_ns / NS_PER_MS)

    def total(which: NDArray[np.intp] | NDArray[np.bool_], of: Floats | None = None) -> Floats:
        """Return the sum of values over the messages ``which`` of each drawn record, (n,); their number without."""
        return np.asarray(times @ np.bincount(part[which], None if of is None else of[which], _PARTS))

    with np.errstate(invalid="ignore", divide="ignore"):
        n_arrived, near = total(~lost), beside_losses(lost)
        columns = [100 * total(lost) / total(np.ones(len(lost), dtype=np.bool_)), total(~lost, delay_ms) / n_arrived]
        columns += list(_quantiles(delay_ms[~lost], part[~lost], times))
        for lag_s in LAGS_S:
            first, second = pairs_apart(trace.sent_ns, delay_ms, lag_s)
            columns.append(_correlations(part[first], delay_ms[first], delay_ms[second], times))
        columns.append(total(near, delay_ms) / total(near))
    parts = [part == number for number in range(_PARTS)]
    longest = np.array([float(loss_runs(lost[own]).longest) if own.any() else 0.0 for own in parts])
    high = np.array([seconds_of_loss(sent_ns[own], lost[own]) if own.any() else 0.0 for own in parts])
    columns += [np.where(times > 0, longest, 0.0).max(axis=1), times @ high]
    return np.stack(columns, axis=1)


def _quantiles(delay_ms: Floats, part: NDArray[np.int64], times: Floats) -> Floats:
    """Return the quantiles `PERCENTS` of delays, (quantiles, n), each part's taken as often as it was drawn."""
    if not len(delay_ms):
        return np.full((len(PERCENTS), len(times)), np.nan)
    values = np.unique(np.quantile(delay_ms, np.linspace(0, 1, _BINS), method="inverted_cdf"))
    place = np.searchsorted(values, delay_ms)
    counts = np.bincount(part * len(values) + place, minlength=_PARTS * len(values)).reshape(_PARTS, -1)
    upto = np.cumsum(times @ counts, axis=1)
    places = [[np.searchsorted(row, row[-1] * percent / 100) for row in upto] for percent in PERCENTS]
    found: Floats = values[np.array(places)]
    return found


def _correlations(part: NDArray[np.int64], x: Floats, y: Floats, times: Floats) -> Floats:
    if not len(x):
        return np.full(len(times), np.nan)
    x, y = x - x.mean(), y - y.mean()
    sums = [times @ np.bincount(part, of, _PARTS) for of in (None, x, y, x * y, x * x, y * y)]
    n, of_x, of_y, of_xy, of_xx, of_yy = sums
    spread = np.sqrt((of_xx / n - (of_x / n) ** 2) * (of_yy / n - (of_y / n) ** 2))
    return np.asarray((of_xy / n - of_x * of_y / n**2) / spread)
