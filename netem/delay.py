"""One-way delay: constant, uniform or normal above 0, and the sum of delay and jitter that a packet gets."""

from collections.abc import Callable
from dataclasses import dataclass
from math import exp, pi, sqrt
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import quad
from scipy.special import ndtr

from common.scenario import network
from common.units import NS_PER_MS
from netem.jitter import Jitter, build_jitter
from netem.truncated_normal import Floats, moments_above, quantile_above

_FAR_SIGMAS = 12.0  # beyond this a normal density is below 1e-31


class Delay(Protocol):
    """A distribution of delays, in ns, none of them negative."""

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delay that each uniform stands for, shape of ``u``."""
        ...

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2), after truncation."""
        ...

    def expect(self, f: Callable[[float], float]) -> float:
        """Return the mean of ``f(delay_ns)``, for a continuous ``f``."""
        ...


@dataclass(frozen=True)
class ConstantDelay:
    """Every packet is equally late."""

    delay_ns: float

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delay, once for each uniform."""
        return np.full(np.shape(u), self.delay_ns)

    def moments_ns(self) -> tuple[float, float]:
        """Return the delay and no variance."""
        return self.delay_ns, 0.0

    def expect(self, f: Callable[[float], float]) -> float:
        """Return ``f`` at the delay."""
        return f(self.delay_ns)


@dataclass(frozen=True)
class UniformDelay:
    """Equally likely between two bounds, which may be equal."""

    low_ns: float
    high_ns: float

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return self.low_ns + u * (self.high_ns - self.low_ns)

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2)."""
        return (self.low_ns + self.high_ns) / 2.0, (self.high_ns - self.low_ns) ** 2 / 12.0

    def expect(self, f: Callable[[float], float]) -> float:
        """Return the mean of ``f``, by adaptive quadrature."""
        width_ns = self.high_ns - self.low_ns
        if width_ns == 0.0:
            return f(self.low_ns)
        return _integral(lambda u: f(self.low_ns + u * width_ns), 0.0, 1.0)


@dataclass(frozen=True)
class NormalDelay:
    """Normal, above 0; ``mean_ns`` and ``std_ns`` are those before truncation."""

    mean_ns: float
    std_ns: float

    def quantile_ns(self, u: Floats) -> Floats:
        """Return the delays, shape of ``u``."""
        return quantile_above(u, self.mean_ns, self.std_ns, 0.0)

    def moments_ns(self) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) of what truncation leaves."""
        return moments_above(self.mean_ns, self.std_ns, 0.0)

    def expect(self, f: Callable[[float], float]) -> float:
        """Return the mean of ``f``, by adaptive quadrature over the standardised delay."""
        if self.moments_ns()[1] == 0.0:
            return f(self.mean_ns)
        low = max(-self.mean_ns / self.std_ns, -_FAR_SIGMAS)

        def weigh(z: float) -> float:
            return f(self.mean_ns + z * self.std_ns) * exp(-z * z / 2.0)

        mass = float(ndtr(-low)) * sqrt(2.0 * pi)
        return (_integral(weigh, low, 0.0) + _integral(weigh, 0.0, _FAR_SIGMAS)) / mass


@dataclass(frozen=True)
class LatencyModel:
    """What a pipeline asks for before ordering: delay plus jitter, from one uniform for each of the two."""

    delay: Delay
    jitter: Jitter | None = None

    def sample(self, u_delay: Floats, u_jitter: Floats) -> NDArray[np.int64]:
        """Return the delays in ns, (N,), never negative, for uniforms (N,) in (0, 1).

        Oracle: scipy.stats, and a loop that really redraws (tests/netem/test_delay).
        """
        total_ns = self.delay.quantile_ns(u_delay)
        if self.jitter is not None:
            # the sum may miss 0 by a rounding error, where the deviation is at its bound
            total_ns = np.maximum(total_ns + self.jitter.quantile_ns(u_jitter, total_ns), 0.0)
        return np.rint(total_ns).astype(np.int64)

    @property
    def mean_ns(self) -> float:
        """Mean of the requested distribution, in ns, after truncation and redraws."""
        mean_ns, _ = self.delay.moments_ns()
        jitter = self.jitter
        if jitter is None:
            return mean_ns
        return mean_ns + self.delay.expect(lambda d: jitter.moments_ns(d)[0])

    @property
    def std_ns(self) -> float:
        """Standard deviation of the requested distribution, in ns, by the law of total variance."""
        jitter = self.jitter
        if jitter is None:
            return sqrt(self.delay.moments_ns()[1])
        mean_ns = self.mean_ns

        def spread(delay_ns: float) -> float:
            deviation_ns, variance = jitter.moments_ns(delay_ns)
            return variance + (delay_ns + deviation_ns - mean_ns) ** 2

        return sqrt(self.delay.expect(spread))


def build_latency(pipeline: network.Pipeline) -> LatencyModel:
    """Return the delay and jitter that a scenario's pipeline asks for; without a delay it is 0."""
    delay: Delay
    match pipeline.delay:
        case None:
            delay = ConstantDelay(0.0)
        case network.ConstantDelay(delay_ms=delay_ms):
            delay = ConstantDelay(delay_ms * NS_PER_MS)
        case network.UniformDelay(low_ms=low_ms, high_ms=high_ms):
            delay = UniformDelay(low_ms * NS_PER_MS, high_ms * NS_PER_MS)
        case network.NormalDelay(mean_ms=mean_ms, std_ms=std_ms):
            delay = NormalDelay(mean_ms * NS_PER_MS, std_ms * NS_PER_MS)
    return LatencyModel(delay, None if pipeline.jitter is None else build_jitter(pipeline.jitter))


def _integral(f: Callable[[float], float], low: float, high: float) -> float:
    """Integrate by adaptive quadrature, to a thousandth of a ns (or ns^2) or nine digits."""
    return float(quad(f, low, high, epsabs=1e-3, epsrel=1e-9)[0])
