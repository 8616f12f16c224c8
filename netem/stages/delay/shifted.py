"""Laws of delay with a shift: a constant plus an unbounded random part; delays above a limit are redrawn.

Redrawing gives the distribution of the part conditioned on the limit. Its quantile function is the part's own at u
times the share that is kept: exact, with one uniform per delay.

The parts: Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", vol. 1, chapters 14 (lognormal), 17
(gamma) and 20 (Pareto).
"""

from dataclasses import dataclass
from functools import cached_property
from math import exp, expm1, log, log1p, sqrt
from typing import Final, Protocol, Self

import numpy as np
import scipy

from tis.common.scenario.network import delay as network
from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Floats
from tis.netem.stages.delay.laws import Delay

_MIN_RELATIVE_VARIANCE: Final = 1e-4
_PRECISION: Final = 1e-13
_ROUNDING: Final = 1e-15  # of ln P(X > x), which bounds the accuracy of a step
_MAX_STEPS: Final = 100

ShiftedLaw = network.LognormalDelay | network.GammaDelay | network.ParetoDelay | network.HyperexponentialDelay


def shifted_law(part: ShiftedLaw) -> "ShiftedDelay":
    """Return the law of a scenario's delay."""
    return ShiftedDelay(_random_part(part), part.shift_ms * NS_PER_MS, part.max_ms * NS_PER_MS)


def _random_part(part: ShiftedLaw) -> "Part":
    match part:
        case network.LognormalDelay():
            return Lognormal.of_moments(part.mean_ms * NS_PER_MS, part.std_ms * NS_PER_MS)
        case network.GammaDelay():
            return Gamma.of_moments(part.mean_ms * NS_PER_MS, part.std_ms * NS_PER_MS)
        case network.ParetoDelay():
            return Lomax(part.shape, part.scale_ms * NS_PER_MS)
        case network.HyperexponentialDelay():
            total = sum(part.weights)  # a scenario's weights sum to 1 only up to rounding
            weights = tuple(weight / total for weight in part.weights)
            return Hyperexponential(weights, tuple(mean_ms * NS_PER_MS for mean_ms in part.means_ms))


class Part(Protocol):
    """A distribution on [0, infinity), in ns."""

    def quantile_ns(self, p: Floats) -> Floats:
        """Return the quantiles of probabilities in (0, 1), shape of ``p``; accurate also near 0."""
        ...

    def cdf(self, x_ns: Floats) -> Floats:
        """Return P(X <= x) for x >= 0, shape of ``x_ns``."""
        ...

    def moments_below(self, limit_ns: float) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) given X <= ``limit_ns``."""
        ...


@dataclass(frozen=True)
class ShiftedDelay(Delay):
    """``shift_ns`` plus a draw of ``part``, redrawn while the sum is above ``max_ns``."""

    part: Part
    shift_ns: float
    max_ns: float

    @cached_property
    def _kept(self) -> float:
        return float(self.part.cdf(np.array([self.max_ns - self.shift_ns]))[0])

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``; none above ``max_ns``."""
        return np.minimum(
            self.shift_ns + self.part.quantile_ns(np.minimum(u * self._kept, 1.0 - 2.0**-53)), self.max_ns
        )

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape."""
        part_ns = np.clip(delay_ns, self.shift_ns, self.max_ns) - self.shift_ns
        return np.minimum(self.part.cdf(part_ns) / self._kept, 1.0)

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) after the redraws.

        Oracle: scipy.integrate over scipy.stats' densities, tests/netem/stages/delay/test_law.
        """
        mean_ns, variance = self.part.moments_below(self.max_ns - self.shift_ns)
        if variance < _MIN_RELATIVE_VARIANCE * mean_ns * mean_ns:
            # the difference of nearly equal moments has lost its digits; quadrature resolves so narrow a part
            none = np.empty(0)
            mean_ns = self.expect(lambda delay_ns: delay_ns - self.shift_ns, none)
            variance = self.expect(lambda delay_ns: (delay_ns - self.shift_ns - mean_ns) ** 2, none)
        return self.shift_ns + mean_ns, variance


@dataclass(frozen=True)
class Lognormal:
    """The exponential of N(mu, sigma^2), in ns."""

    mu: float
    sigma: float

    @classmethod
    def of_moments(cls, mean_ns: float, std_ns: float) -> Self:
        """Return the lognormal distribution with this mean and standard deviation."""
        variance = log1p((std_ns / mean_ns) ** 2)
        return cls(log(mean_ns) - variance / 2.0, sqrt(variance))

    def quantile_ns(self, p: Floats) -> Floats:
        """Return the quantiles, shape of ``p``."""
        return np.asarray(np.exp(self.mu + self.sigma * scipy.special.ndtri(p)))

    def cdf(self, x_ns: Floats) -> Floats:
        """Return P(X <= x), shape of ``x_ns``."""
        with np.errstate(divide="ignore"):
            return np.asarray(scipy.special.ndtr((np.log(x_ns) - self.mu) / self.sigma))

    def moments_below(self, limit_ns: float) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) given X <= ``limit_ns``.

        E[X^k; X <= m] = exp(k mu + k^2 sigma^2 / 2) Phi((ln m - mu) / sigma - k sigma).
        """
        bound = (log(limit_ns) - self.mu) / self.sigma
        first, second = scipy.special.ndtr(bound - self.sigma * np.array([1.0, 2.0])) / scipy.special.ndtr(bound)
        mean_ns = exp(self.mu + self.sigma**2 / 2.0)
        return float(mean_ns * first), float(mean_ns**2 * (exp(self.sigma**2) * second - first**2))


@dataclass(frozen=True)
class Gamma:
    """Gamma with a shape and a scale in ns; shape 1 is the exponential distribution."""

    shape: float
    scale_ns: float

    @classmethod
    def of_moments(cls, mean_ns: float, std_ns: float) -> Self:
        """Return the gamma distribution with this mean and standard deviation."""
        return cls((mean_ns / std_ns) ** 2, std_ns**2 / mean_ns)

    def quantile_ns(self, p: Floats) -> Floats:
        """Return the quantiles, shape of ``p``."""
        if self.shape == 1.0:  # the general formula gives the same, several times slower
            return np.asarray(-self.scale_ns * np.log1p(-p))
        return np.asarray(self.scale_ns * scipy.special.gammaincinv(self.shape, p))

    def cdf(self, x_ns: Floats) -> Floats:
        """Return P(X <= x), shape of ``x_ns``."""
        return np.asarray(scipy.special.gammainc(self.shape, x_ns / self.scale_ns))

    def moments_below(self, limit_ns: float) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) given X <= ``limit_ns``.

        E[X^k; X <= m] = scale^k a (a + 1) .. (a + k - 1) P(a + k, m / scale), P the incomplete gamma function.
        """
        a, limit = self.shape, limit_ns / self.scale_ns
        first, second = scipy.special.gammainc(a + np.array([1.0, 2.0]), limit) / scipy.special.gammainc(a, limit)
        mean_ns = self.scale_ns * a * first
        return float(mean_ns), float(self.scale_ns**2 * a * (a + 1.0) * second - mean_ns**2)


@dataclass(frozen=True)
class Lomax:
    """Pareto of the second kind, P(X > x) = (1 + x / scale) ** -shape, with a tail index ``shape`` and a scale in ns.

    It has no mean if the shape is at most 1 and no variance if it is at most 2; the limit makes both finite.
    """

    shape: float
    scale_ns: float

    def quantile_ns(self, p: Floats) -> Floats:
        """Return the quantiles, shape of ``p``."""
        return np.asarray(self.scale_ns * np.expm1(-np.log1p(-p) / self.shape))

    def cdf(self, x_ns: Floats) -> Floats:
        """Return P(X <= x), shape of ``x_ns``."""
        return np.asarray(-np.expm1(-self.shape * np.log1p(x_ns / self.scale_ns)))

    def moments_below(self, limit_ns: float) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) given X <= ``limit_ns``, for any shape.

        With Y = 1 + X / scale <= e^L: E[Y^k] = a L exprel((k - a) L) / (1 - e^(-a L)), also where k = a.
        """
        length = log1p(limit_ns / self.scale_ns)
        kept = -expm1(-self.shape * length)
        first, second = (
            self.shape * length * scipy.special.exprel((np.array([1.0, 2.0]) - self.shape) * length) / kept
        )
        return float(self.scale_ns * (first - 1.0)), float(self.scale_ns**2 * (second - first**2))


@dataclass(frozen=True)
class Hyperexponential:
    """Exponential distributions with ``means_ns``, each chosen with its weight; the weights sum to 1."""

    weights: tuple[float, ...]
    means_ns: tuple[float, ...]

    def quantile_ns(self, p: Floats) -> Floats:
        """Return the quantiles, shape of ``p``, by Newton's method.

        ln P(X > x) is convex and decreasing in x, so Newton's steps from below the root increase x and never pass
        the root; where one exponential dominates, one step suffices (oracle: bisection, test_hyperexponential).
        """
        parts = list(zip(self.weights, self.means_ns, strict=True))
        goal = np.log1p(-p)
        # start below the root: P(X > x) is at least each term, and at least the exponential of the mean rate (Jensen)
        x_ns = np.asarray(-goal / sum(weight / mean_ns for weight, mean_ns in parts))
        for weight, mean_ns in parts:
            x_ns = np.maximum(x_ns, mean_ns * (log(weight) - goal))
        for _ in range(_MAX_STEPS):
            beyond, density = np.zeros(x_ns.shape), np.zeros(x_ns.shape)
            for weight, mean_ns in parts:
                term = weight * np.exp(x_ns / -mean_ns)
                beyond += term
                density += term / mean_ns
            slope_ns = beyond / density
            step_ns = (np.log(beyond) - goal) * slope_ns
            x_ns = np.maximum(x_ns + step_ns, 0.0)
            if (step_ns <= _PRECISION * x_ns + _ROUNDING * slope_ns).all():
                break
        return x_ns

    def cdf(self, x_ns: Floats) -> Floats:
        """Return P(X <= x), shape of ``x_ns``."""
        share = np.zeros(np.shape(x_ns))
        for weight, mean_ns in zip(self.weights, self.means_ns, strict=True):
            share -= weight * np.expm1(x_ns / -mean_ns)
        return share

    def moments_below(self, limit_ns: float) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) given X <= ``limit_ns``.

        For one exponential, E[X^k; X <= m] = k! mean^k P(k + 1, m / mean), P the incomplete gamma function.
        """
        weights, means_ns = np.array(self.weights), np.array(self.means_ns)
        zeroth, first, second = (
            float((weights * factor * means_ns**k * scipy.special.gammainc(k + 1, limit_ns / means_ns)).sum())
            for k, factor in enumerate((1.0, 1.0, 2.0))
        )
        mean_ns = first / zeroth
        return mean_ns, second / zeroth - mean_ns**2
