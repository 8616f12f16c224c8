"""The half-life of the correlation of delays, by their Gaussian scores."""

from collections.abc import Callable
from math import exp, log, sqrt
from typing import Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from tis.common.units import NS_PER_S
from tis.netem.draws.blocks import Floats

_MIN_ARRIVED: Final = 150
_MIN_HALF_LIFE_S: Final = 0.001  # the grid of the model
_MIN_INTERVALS: Final = 0.5  # leaves a quarter after one message; below, half-lives cannot be distinguished
_TESTED_LAGS: Final = 8
_P_INDEPENDENT: Final = 1e-3
_FADED: Final = 0.15
_PARTS: Final = 10
_TIMES_A_LAG: Final = 64


class HalfLife(NamedTuple):
    """The half-life in ``seconds``, or None with the reason ``why``, mostly indistinguishable independent delays.

    ``interval`` is a 95 % confidence interval by the jackknife over ten parts of the record. ``correlated_share`` is
    the share of the scores' variance that decays with this half-life; the rest changes from message to message, which
    the model does not have.
    """

    seconds: float | None
    interval: tuple[float, float] | None
    correlated_share: float | None
    why: str

    @property
    def words(self) -> str:
        """Return the half-life with its interval and share, or why there is none."""
        if self.seconds is None or self.correlated_share is None:
            return f"none: {self.why}"
        within = "" if self.interval is None else " (95 %: {:.4g} to {:.4g})".format(*self.interval)
        return f"half-life {self.seconds:.4g} s{within}, {100 * self.correlated_share:.0f} % of the variance"


class _Lag(NamedTuple):
    """Pairs of messages at one lag: summed products of scores by part, number of pairs, times between them."""

    products: Floats
    n_pairs: Floats
    apart_s: Floats


def gaussian_scores(delay_ns: NDArray[np.int64]) -> Floats:
    """Return the normal quantiles of the ranks, (N,): the Ornstein-Uhlenbeck process behind the delays."""
    scores: Floats = scipy.special.ndtri((scipy.stats.rankdata(delay_ns) - 0.5) / len(delay_ns))
    return scores


def fit_half_life(sent_ns: NDArray[np.int64], delay_ns: NDArray[np.int64]) -> HalfLife:
    """Return the half-life of the correlation of delays, both (N,), lost messages left out, ``sent_ns`` ascending.

    The autocorrelation of the Gaussian scores is fitted, by least squares at lags of 1, 2, 3, ... messages until it
    has decayed, with the mean of 2 ** (-t / half-life) over the times t between these messages, so gaps and uneven
    sampling need no filling. Independence is tested as by Box and Pierce. A half-life below half a (median) message
    interval cannot be resolved and is None. Oracle: autoregressive paths of numpy's generator,
    tests/netem/fit/test_half_life.
    """
    if len(delay_ns) < _MIN_ARRIVED:
        return HalfLife(None, None, None, f"{len(delay_ns)} messages arrived, it takes {_MIN_ARRIVED}")
    if delay_ns.min() == delay_ns.max():
        return HalfLife(None, None, None, "all delays are equal")
    # Stage 1: are the delays correlated at all?
    z = gaussian_scores(delay_ns)
    z /= z.std()
    seconds = (sent_ns - sent_ns[0]) / NS_PER_S
    first = [_lag(z, seconds, k) for k in range(1, _TESTED_LAGS + 1)]
    statistic = sum(float(lag.n_pairs.sum()) * _rho(lag) ** 2 for lag in first)
    if scipy.special.chdtrc(_TESTED_LAGS, statistic) > _P_INDEPENDENT:
        return HalfLife(None, None, None, "indistinguishable from independent delays")
    if _rho(first[0]) <= 0:
        return HalfLife(None, None, None, "neighbours differ more than independent delays would")
    # Stage 2: the half-life, if the model and the message rate can resolve it.
    lags = _fading(z, seconds, first[0])
    whole, share = _match(lags, None)
    if whole < _MIN_HALF_LIFE_S:
        return HalfLife(None, None, share, "correlated for less than the 1 ms that the model resolves")
    interval_s = float(np.median(np.diff(seconds)))
    if whole < _MIN_INTERVALS * interval_s:
        why = f"its half-life is less than {_MIN_INTERVALS:g} message intervals of {interval_s * 1000:.3g} ms"
        return HalfLife(None, None, share, f"{why}: cannot be resolved at this rate")
    # Stage 3: its confidence interval, symmetric in the logarithm.
    logs = np.log([_match(lags, left_out)[0] for left_out in range(_PARTS)])
    error = sqrt((_PARTS - 1) * float(logs.var()))
    interval = (whole * exp(-2.262 * error), whole * exp(2.262 * error))  # Student's t, 9 degrees of freedom
    return HalfLife(whole, interval, share, "")


def _fading(z: Floats, seconds: Floats, first: _Lag) -> list[_Lag]:
    lags, k = [first], 1
    while _rho(lags[-1]) > _FADED and len(lags) < 200:
        k = max(k + 1, int(k * 1.15))
        if k > len(z) // _PARTS:
            break
        lags.append(_lag(z, seconds, k))
    return lags


def _lag(z: Floats, seconds: Floats, k: int) -> _Lag:
    products = z[:-k] * z[k:]
    edges = np.linspace(0, len(products), _PARTS + 1).astype(np.int64)
    apart = np.sort(seconds[k:] - seconds[:-k])
    places = ((np.arange(_TIMES_A_LAG) + 0.5) / _TIMES_A_LAG * len(apart)).astype(np.int64)
    return _Lag(np.add.reduceat(products, edges[:-1]), np.diff(edges).astype(np.float64), apart[places])


def _rho(lag: _Lag, left_out: int | None = None) -> float:
    products, n = float(lag.products.sum()), float(lag.n_pairs.sum())
    if left_out is not None:
        products, n = products - float(lag.products[left_out]), n - float(lag.n_pairs[left_out])
    return products / n


def _match(lags: list[_Lag], left_out: int | None) -> tuple[float, float]:
    """Return the best half-life in s, and the share of the variance that a fit with a free share gives it."""
    rho = np.array([_rho(lag, left_out) for lag in lags])
    apart = np.array([lag.apart_s for lag in lags])

    def model(log_s: float) -> Floats:
        similarity: Floats = np.mean(2.0 ** (-apart / exp(log_s)), axis=1)
        return similarity

    def squared(log_s: float) -> float:
        off = rho - model(log_s)
        return float(off @ off)

    grid = np.linspace(log(max(float(apart.min()) / 20, 1e-6)), log(float(apart.max()) * 20), 80)
    best = int(np.argmin([squared(float(at)) for at in grid]))
    around = (float(grid[max(best - 1, 0)]), float(grid[min(best + 1, len(grid) - 1)]))
    found = scipy.optimize.minimize_scalar(squared, bounds=around, method="bounded", options={"xatol": 1e-5})
    share = _free_share(rho, model, grid)
    return exp(float(found.x)), share


def _free_share(rho: Floats, model: Callable[[float], Floats], grid: Floats) -> float:
    """Return the share c of the variance in rho = c 2 ** (-t / h), h free; 1 with fewer than three lags."""
    if len(rho) < 3:
        return 1.0
    best, share = np.inf, 1.0
    for at in grid:
        shape = model(float(at))
        c = float(rho @ shape) / float(shape @ shape)
        off = rho - c * shape
        if float(off @ off) < best:
            best, share = float(off @ off), c
    return min(share, 1.0)
