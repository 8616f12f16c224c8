"""Families of delay distributions, each fitted by maximum likelihood to a sample of N ascending values in ms.

The shift of a shifted family is searched below the minimum of the sample: at the minimum itself the likelihood of a
lognormal or gamma distribution is unbounded, so the search stops just below it.
"""

from collections.abc import Callable
from math import exp, inf, log, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from tis.netem.draws.blocks import Floats

_MIN_SHIFT_GAP: Final = 1e-3  # of the distance from minimum to median
_MAX_SHAPE: Final = 50
_EM_STEPS: Final = 300
_EM_SETTLED: Final = 1e-9


class Fitted(NamedTuple):
    """A fitted family: its stage as in a scenario, its distribution function and its likelihood.

    ``mean_log_density`` is per value, in nats for densities per ms.
    """

    stage: dict[str, Any]
    cdf: Callable[[Floats], Floats]
    mean_log_density: float
    n_parameters: int


def uniform(x: Floats) -> Fitted | None:
    """Fit low and high: the extremes."""
    low, high = float(x[0]), float(x[-1])
    if high <= low:
        return None
    stage = {"kind": "uniform", "low_ms": low, "high_ms": high}
    return Fitted(stage, lambda v: np.clip((v - low) / (high - low), 0.0, 1.0), -log(high - low), 2)


def normal(x: Floats) -> Fitted | None:
    """Fit mean and deviation; None if redraws of negative values would change them noticeably."""
    mean, std = float(x.mean()), float(x.std())
    if std <= 0 or mean < 4 * std:
        return None
    z = (x - mean) / std
    density = float(np.mean(-0.5 * z * z)) - log(std * sqrt(2 * np.pi))
    stage = {"kind": "normal", "mean_ms": mean, "std_ms": std}
    return Fitted(
        stage, lambda v: scipy.special.ndtr((v - mean) / std), density - float(scipy.special.log_ndtr(mean / std)), 2
    )


def lognormal(x: Floats) -> Fitted | None:
    """Fit shift, mean and deviation of a shifted lognormal distribution."""

    def at(shift: float) -> tuple[float, float, float]:
        logs = np.log(x - shift)
        mu, sigma = float(logs.mean()), float(logs.std())
        return -mu - log(sigma) - 0.5 * log(2 * np.pi) - 0.5, mu, sigma

    shift = _best_shift(x, lambda s: at(s)[0])
    if shift is None:
        return None
    density, mu, sigma = at(shift)
    if sigma > 5:  # exp(sigma^2) would exceed the numbers that a scenario accepts
        return None
    mean = exp(mu + sigma * sigma / 2)
    stage = {"kind": "lognormal", "shift_ms": shift, "mean_ms": mean, "std_ms": mean * sqrt(exp(sigma * sigma) - 1)}
    return Fitted(
        stage, lambda v: scipy.special.ndtr((np.log(np.maximum(v - shift, 1e-300)) - mu) / sigma), density, 3
    )


def exponential(x: Floats) -> Fitted | None:
    """Fit shift and mean of a shifted exponential distribution: a gamma with the deviation equal to the mean."""
    shift = _edge(x)
    mean = float(x.mean()) - shift
    if mean <= 0:
        return None
    stage = {"kind": "gamma", "shift_ms": shift, "mean_ms": mean, "std_ms": mean}
    return Fitted(stage, lambda v: -np.expm1(-np.maximum(v - shift, 0.0) / mean), -log(mean) - 1, 2)


def gamma(x: Floats) -> Fitted | None:
    """Fit shift, mean and deviation of a shifted gamma distribution; its shape by mean and mean logarithm."""

    def at(shift: float) -> tuple[float, float, float]:
        above = x - shift
        mean = float(above.mean())
        gap = log(mean) - float(np.log(above).mean())
        shape = (
            float(scipy.optimize.brentq(lambda k: log(k) - scipy.special.digamma(k) - gap, 1e-3, 1e9))
            if gap > 1e-9
            else 1e9
        )
        scale = mean / shape
        density = (shape - 1) * (log(mean) - gap) - shape - shape * log(scale) - float(scipy.special.gammaln(shape))
        return density, shape, scale

    shift = _best_shift(x, lambda s: at(s)[0])
    if shift is None:
        return None
    density, shape, scale = at(shift)
    stage = {"kind": "gamma", "shift_ms": shift, "mean_ms": shape * scale, "std_ms": sqrt(shape) * scale}

    def cdf(v: Floats) -> Floats:
        below: Floats = scipy.special.gammainc(shape, np.maximum(v - shift, 0.0) / scale).astype(np.float64)
        return below

    return Fitted(stage, cdf, density, 3)


def pareto(x: Floats) -> Fitted | None:
    """Fit shift, scale and shape of a shifted Pareto II distribution, truncated at the largest value."""
    shift = _edge(x)
    above = x - shift
    mean = float(above.mean())
    if mean <= 0:
        return None

    def shape_at(scale: float) -> float:
        return 1.0 / float(np.log1p(above / scale).mean())

    def density_at(log_scale: float) -> float:
        scale = exp(log_scale)
        shape = shape_at(scale)
        return log(shape / scale) - (shape + 1) / shape

    best = scipy.optimize.minimize_scalar(
        lambda s: -density_at(s),
        bounds=(log(mean * 1e-4), log(mean * 1e4)),
        method="bounded",
        options={"xatol": 1e-6},
    )
    scale = exp(float(best.x))
    shape = shape_at(scale)
    if shape > _MAX_SHAPE:  # practically exponential
        return None
    stage = {"kind": "pareto", "shift_ms": shift, "scale_ms": scale, "shape": shape, "max_ms": float(x[-1])}
    return Fitted(stage, lambda v: 1 - (1 + np.maximum(v - shift, 0.0) / scale) ** -shape, -float(best.fun), 3)


def hyperexponential(x: Floats) -> Fitted | None:
    """Fit shift, weights and means of a mixture of two exponentials by expectation maximisation."""
    shift = _edge(x)
    above = x - shift
    half = len(above) // 2
    means = np.array([above[:half].mean(), above[half:].mean()])
    if means[0] <= 0:
        return None
    weights = np.array([0.5, 0.5])
    before = -inf
    for _ in range(_EM_STEPS):
        parts = weights[:, None] / means[:, None] * np.exp(-above / means[:, None])
        total = parts.sum(axis=0)
        density = float(np.log(total).mean())
        belongs = parts / total
        weights = belongs.mean(axis=1)
        means = (belongs @ above) / belongs.sum(axis=1)
        if density - before < _EM_SETTLED:
            break
        before = density
    if not weights.min() > 1e-4 or means.max() / means.min() < 1.05:  # one exponential: gamma covers it
        return None
    stage = {
        "kind": "hyperexponential",
        "shift_ms": shift,
        "weights": [float(w) for w in weights],
        "means_ms": [float(m) for m in means],
    }

    def cdf(v: Floats) -> Floats:
        below: Floats = 1 - weights @ np.exp(-np.maximum(v - shift, 0.0) / means[:, None])
        return below

    return Fitted(stage, cdf, density, 4)


FAMILIES: Final[dict[str, Callable[[Floats], Fitted | None]]] = {
    "uniform": uniform,
    "normal": normal,
    "lognormal": lognormal,
    "exponential": exponential,
    "gamma": gamma,
    "pareto": pareto,
    "hyperexponential": hyperexponential,
}


def _edge(x: Floats) -> float:
    """Return the beginning of a decreasing density: the minimum lies 1/N of the mean distance above it."""
    return max(0.0, float(x[0] - (x.mean() - x[0]) / len(x)))


def _best_shift(x: Floats, density: Callable[[float], float]) -> float | None:
    """Return the shift between 0 and the minimum with the highest likelihood; None without spread or at 0."""
    low, spread = float(x[0]), float(np.median(x) - x[0])
    if spread <= 0 or low <= 0:
        return None
    gaps = np.geomspace(min(spread * _MIN_SHIFT_GAP, low), low, 25)
    best = int(np.argmax([density(low - gap) for gap in gaps]))
    around = (log(gaps[max(best - 1, 0)]), log(gaps[min(best + 1, len(gaps) - 1)]))
    if around[0] == around[1]:
        return low - float(gaps[best])
    found = scipy.optimize.minimize_scalar(
        lambda g: -density(low - exp(g)), bounds=around, method="bounded", options={"xatol": 1e-5}
    )
    return max(0.0, low - exp(float(found.x)))
