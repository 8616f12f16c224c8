"""Laws of delay: their interface, and those that need no shift: constant, uniform, normal, or given by quantiles."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from math import pi, sqrt
from typing import Final

import numpy as np
import scipy

from tis.common.scenario.network import delay as network
from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Floats

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(16)
_FRACTIONS: Final = (_NODES + 1.0) / 2.0
_SHARES: Final = _WEIGHTS / 2.0
# dense towards both ends, where quantile functions have their singularities
_HALVINGS: Final = 0.5 ** np.arange(50, 0, -1)
_MAX_U: Final = 1.0 - 2.0**-53
MIN_STD_NS: Final = 1e-6  # delays are rounded to 1 ns: less is no spread, and would overflow the ratios below


class Delay(ABC):
    """A distribution of non-negative delays, in ns; it draws a delay from one uniform by its quantile function."""

    @abstractmethod
    def quantile_ns(self, u: Floats) -> Floats:
        """Return the quantile for each uniform in (0, 1), shape of ``u``."""

    @abstractmethod
    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape."""

    @abstractmethod
    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) of the drawn delays, after all redraws."""

    def knots(self) -> Floats:
        """Return the probabilities at which the quantile function bends."""
        return np.empty(0)

    def expect(self, f: Callable[[Floats], Floats], bends_ns: Floats) -> float:
        """Return the mean of a bounded ``f`` of the delay, by Gauss-Legendre quadrature over the probability.

        Intervals end where the quantile function or ``f`` bends, at delays ``bends_ns``, and halve towards 0 and 1. A
        tail of probability 2^-50 is not resolved, so ``f`` must be bounded. Oracle: scipy.integrate,
        tests/netem/stages/delay/test_law.
        """
        inner = np.concatenate([_HALVINGS, 1.0 - _HALVINGS, self.knots(), self.cdf(np.maximum(bends_ns, 0.0))])
        edges = np.unique(np.concatenate([[0.0, 1.0], np.clip(inner, 0.0, 1.0)]))
        widths = np.diff(edges)
        u = np.minimum(edges[:-1, None] + widths[:, None] * _FRACTIONS, _MAX_U)
        values = f(self.quantile_ns(u.ravel())).reshape(u.shape)
        return float(((values * _SHARES).sum(axis=1) * widths).sum())


OwnLaw = network.ConstantDelay | network.UniformDelay | network.NormalDelay | network.QuantileDelay


def own_law(part: OwnLaw) -> Delay:
    """Return the law of a scenario's delay."""
    match part:
        case network.ConstantDelay():
            return ConstantDelay(part.delay_ms * NS_PER_MS)
        case network.UniformDelay():
            return UniformDelay(part.low_ms * NS_PER_MS, part.high_ms * NS_PER_MS)
        case network.NormalDelay():
            return NormalDelay(part.mean_ms * NS_PER_MS, part.std_ms * NS_PER_MS)
        case network.QuantileDelay():
            delays_ns = np.array([point.delay_ms for point in part.points]) * NS_PER_MS
            return QuantileDelay(np.array([point.p for point in part.points]), delays_ns)


@dataclass(frozen=True)
class ConstantDelay(Delay):
    """The same delay for all packets."""

    delay_ns: float

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delay, shape of ``u``."""
        return np.full(np.shape(u), self.delay_ns)

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return 1 from the delay on, 0 below it."""
        return np.asarray(delay_ns >= self.delay_ns, np.float64)

    def moments_ns(self) -> tuple[float, float]:
        """Return the delay and variance 0."""
        return self.delay_ns, 0.0

    def expect(self, f: Callable[[Floats], Floats], bends_ns: Floats) -> float:  # noqa: ARG002
        """Return ``f`` at the delay."""
        return float(f(np.array([self.delay_ns]))[0])


@dataclass(frozen=True)
class UniformDelay(Delay):
    """Uniform between two bounds, which may be equal."""

    low_ns: float
    high_ns: float

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return self.low_ns + u * (self.high_ns - self.low_ns)

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape."""
        if self.high_ns == self.low_ns:
            return np.asarray(delay_ns >= self.low_ns, np.float64)
        return np.clip((delay_ns - self.low_ns) / (self.high_ns - self.low_ns), 0.0, 1.0)

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2)."""
        return (self.low_ns + self.high_ns) / 2.0, (self.high_ns - self.low_ns) ** 2 / 12.0


@dataclass(frozen=True)
class NormalDelay(Delay):
    """Normal, truncated at 0; ``mean_ns`` and ``std_ns`` are those before truncation."""

    mean_ns: float
    std_ns: float

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return quantile_above(u, self.mean_ns, self.std_ns, 0.0)

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape."""
        return cdf_above(delay_ns, self.mean_ns, self.std_ns, 0.0)

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) after truncation."""
        mean_ns, variance = moments_above(self.mean_ns, self.std_ns, 0.0)
        return float(mean_ns), float(variance)


@dataclass(frozen=True, eq=False)
class QuantileDelay(Delay):
    """A quantile table: ``shares`` (N,) ascend strictly from 0 to 1, ``delays_ns`` (N,) do not descend."""

    shares: Floats
    delays_ns: Floats

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return np.interp(u, self.shares, self.delays_ns)

    def cdf(self, delay_ns: Floats) -> Floats:
        """Return the share of delays at most ``delay_ns``, same shape; it jumps where quantiles are equal."""
        after = np.searchsorted(self.delays_ns, delay_ns, side="right")
        low, high = np.maximum(after - 1, 0), np.minimum(after, len(self.shares) - 1)
        width_ns = self.delays_ns[high] - self.delays_ns[low]
        part = np.where(width_ns > 0, (delay_ns - self.delays_ns[low]) / np.where(width_ns > 0, width_ns, 1.0), 0.0)
        return np.asarray(np.where(after == 0, 0.0, self.shares[low] + part * (self.shares[high] - self.shares[low])))

    def knots(self) -> Floats:
        """Return the probabilities of the table."""
        return self.shares

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2): each piece is uniform."""
        widths = np.diff(self.shares)
        middles_ns = (self.delays_ns[:-1] + self.delays_ns[1:]) / 2.0
        mean_ns = float((widths * middles_ns).sum())
        within = np.diff(self.delays_ns) ** 2 / 12.0
        return mean_ns, float((widths * ((middles_ns - mean_ns) ** 2 + within)).sum())


def quantile_above(u: Floats, mean_ns: float, std_ns: float, lower_ns: Floats | float) -> Floats:
    """Return the quantiles of N(mean, std^2) given that it is at least ``lower_ns``, shape of ``u``.

    That is the result of redrawing every value below a bound: Johnson, Kotz, Balakrishnan, "Continuous Univariate
    Distributions", vol. 1, section 13.10.1. ``u`` lies in (0, 1); ``lower_ns`` must not exceed ``mean_ns``. Without
    spread all values are ``mean_ns``. Each value needs one uniform, so a redraw does not shift another packet's draws
    (oracle: scipy.stats.truncnorm, test_latency).
    """
    if std_ns < MIN_STD_NS:
        return np.full(np.shape(u), mean_ns)
    above = scipy.special.ndtr((mean_ns - lower_ns) / std_ns)
    below, beyond = 1.0 - above + u * above, (1.0 - u) * above
    # by the smaller of the two tails: ndtri cannot resolve probabilities near 1
    z = scipy.special.ndtri(np.minimum(below, beyond))
    return np.maximum(mean_ns + std_ns * np.where(below < beyond, z, -z), lower_ns)


def cdf_above(x_ns: Floats, mean_ns: float, std_ns: float, lower_ns: Floats | float) -> Floats:
    """Return P(X <= x) of N(mean, std^2) given that it is at least ``lower_ns``, shape of ``x_ns``.

    ``lower_ns`` must not exceed ``mean_ns``. Oracle: the inverse of `quantile_above`,
    tests/netem/stages/delay/test_truncated_normal.
    """
    if std_ns < MIN_STD_NS:
        return np.asarray(x_ns >= mean_ns, np.float64)
    above = scipy.special.ndtr((mean_ns - lower_ns) / std_ns)
    beyond = scipy.special.ndtr((mean_ns - np.maximum(x_ns, lower_ns)) / std_ns)
    return np.asarray(1.0 - beyond / above)


def moments_above(mean_ns: float, std_ns: float, lower_ns: Floats | float) -> tuple[Floats, Floats]:
    """Return mean (ns) and variance (ns^2) of N(mean, std^2) given that it is at least ``lower_ns``, in its shape."""
    bound_ns = np.asarray(lower_ns, np.float64)
    if std_ns < MIN_STD_NS:
        return np.full(bound_ns.shape, mean_ns), np.zeros(bound_ns.shape)
    alpha = (bound_ns - mean_ns) / std_ns
    hazard = np.exp(-alpha * alpha / 2.0) / sqrt(2.0 * pi) / scipy.special.ndtr(-alpha)
    return mean_ns + std_ns * hazard, std_ns * std_ns * (1.0 + alpha * hazard - hazard * hazard)
