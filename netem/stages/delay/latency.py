"""Latency: the sum of delay and jitter, with its draws, mean, standard deviation and quantiles.

Jitter is a deviation added to a packet's delay, redrawn while the sum is negative. So the deviation has its
distribution conditioned on being at least minus the delay. Where the delay exceeds every deviation nothing is
redrawn, and mean and spread are the requested ones.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import sqrt
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network import delay as network
from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Floats
from tis.netem.stages.delay.laws import MIN_STD_NS, Delay, cdf_above, moments_above, quantile_above

_WIDTH_NS: Final = 1e-3
_MAX_STEPS: Final = 200
_N_DEVIATIONS: Final = 101
_GOLDEN: Final = (5.0**0.5 - 1.0) / 2.0
_MAX_SIGMAS: Final = 9  # a normal deviation beyond has a probability of 1e-19


class Jitter(Protocol):
    """A deviation from the delay, in ns."""

    @property
    def reach_ns(self) -> float:
        """Return the greatest deviation in either direction; 0 without spread."""
        ...

    @property
    def bends_ns(self) -> Floats:
        """Return the deviations at which quadrature has to place edges, ascending from 0 to `reach_ns`."""
        ...

    def quantile_ns(self, u: Floats, delay_ns: Floats) -> Floats:
        """Return the deviation for each uniform and delay, both (N,)."""
        ...

    def cdf(self, deviation_ns: Floats, delay_ns: Floats) -> Floats:
        """Return the share of deviations at most ``deviation_ns`` for each delay, both (N,)."""
        ...

    def moments_ns(self, delay_ns: Floats) -> tuple[Floats, Floats]:
        """Return the mean (ns) and variance (ns^2) of the deviation for each delay, shape of ``delay_ns``."""
        ...


@dataclass(frozen=True)
class NormalJitter:
    """Normal with mean 0, truncated at minus the delay."""

    std_ns: float

    @property
    def reach_ns(self) -> float:
        """Return nine standard deviations."""
        return _MAX_SIGMAS * self.std_ns if self.std_ns >= MIN_STD_NS else 0.0

    @property
    def bends_ns(self) -> Floats:
        """Return the multiples of the standard deviation."""
        return np.linspace(0.0, self.reach_ns, _MAX_SIGMAS + 1)

    def quantile_ns(self, u: Floats, delay_ns: Floats) -> Floats:
        """Return the deviations, (N,)."""
        return quantile_above(u, 0.0, self.std_ns, -delay_ns)

    def cdf(self, deviation_ns: Floats, delay_ns: Floats) -> Floats:
        """Return the share of deviations at most ``deviation_ns``, (N,)."""
        return cdf_above(deviation_ns, 0.0, self.std_ns, -delay_ns)

    def moments_ns(self, delay_ns: Floats) -> tuple[Floats, Floats]:
        """Return the mean (ns) and variance (ns^2) of the deviation for each delay."""
        return moments_above(0.0, self.std_ns, -delay_ns)


@dataclass(frozen=True)
class UniformJitter:
    """Uniform between plus and minus ``half_width_ns``, truncated at minus the delay."""

    half_width_ns: float

    @property
    def reach_ns(self) -> float:
        """Return the half width."""
        return self.half_width_ns

    @property
    def bends_ns(self) -> Floats:
        """Return 0 and the half width."""
        return np.array([0.0, self.half_width_ns])

    def quantile_ns(self, u: Floats, delay_ns: Floats) -> Floats:
        """Return the deviations, (N,)."""
        low = self._low_ns(delay_ns)
        return np.asarray(low + u * (self.half_width_ns - low))

    def cdf(self, deviation_ns: Floats, delay_ns: Floats) -> Floats:
        """Return the share of deviations at most ``deviation_ns``, (N,)."""
        if self.half_width_ns == 0.0:
            return np.asarray(deviation_ns >= 0.0, np.float64)
        low = self._low_ns(delay_ns)
        return np.clip((deviation_ns - low) / (self.half_width_ns - low), 0.0, 1.0)

    def moments_ns(self, delay_ns: Floats) -> tuple[Floats, Floats]:
        """Return the mean (ns) and variance (ns^2) of the deviation for each delay."""
        low = self._low_ns(delay_ns)
        return (low + self.half_width_ns) / 2.0, (self.half_width_ns - low) ** 2 / 12.0

    def _low_ns(self, delay_ns: Floats) -> Floats:
        return np.maximum(-self.half_width_ns, -delay_ns)


def build_jitter(part: network.NormalJitter | network.UniformJitter) -> Jitter:
    """Return the jitter of a scenario's stage."""
    if isinstance(part, network.NormalJitter):
        return NormalJitter(part.std_ms * NS_PER_MS)
    return UniformJitter(part.half_width_ms * NS_PER_MS)


@dataclass(frozen=True)
class LatencyModel:
    """The requested delay before ordering: delay plus jitter, from one uniform each."""

    delay: Delay
    jitter: Jitter | None = None

    def sample(self, u_delay: Floats, u_jitter: Floats) -> NDArray[np.int64]:
        """Return the delays in ns, (N,), never negative, for uniforms (N,) in (0, 1).

        Oracle: scipy.stats, and a loop that redraws (tests/netem/stages/delay/test_latency).
        """
        return self.with_jitter(self.delay.quantile_ns(u_delay), u_jitter)

    def with_jitter(self, delay_ns: Floats, u_jitter: Floats) -> NDArray[np.int64]:
        """Return given delays (N,) plus jitter, in whole ns, (N,), never negative."""
        if self.jitter is not None:
            # the sum may fall below 0 by a rounding error where the deviation is at its bound
            delay_ns = np.maximum(delay_ns + self.jitter.quantile_ns(u_jitter, delay_ns), 0.0)
        return np.rint(delay_ns).astype(np.int64)

    @property
    def mean_ns(self) -> float:
        """Mean of the requested distribution, in ns, after truncation and redraws."""
        return self.delay.moments_ns()[0] + self._shift_ns()

    @property
    def std_ns(self) -> float:
        """Standard deviation of the requested distribution, in ns, by the law of total variance."""
        mean_ns, variance = self.delay.moments_ns()
        jitter = self.jitter
        if jitter is None:
            return sqrt(variance)
        shift_ns = self._shift_ns()

        def spread(delay_ns: Floats) -> Floats:
            deviation_ns, own = jitter.moments_ns(delay_ns)
            # without the delay's own spread, which is known: `expect` needs a bounded function
            return own + (deviation_ns - shift_ns) ** 2 + 2.0 * (delay_ns - mean_ns) * deviation_ns

        return sqrt(max(variance + self.delay.expect(spread, jitter.bends_ns), 0.0))

    def quantiles_ns(self, ps: Iterable[float]) -> list[float]:
        """Return the quantiles of the delay in ns, at probabilities ``ps`` in (0, 1).

        Without jitter these are the quantiles of the distribution itself; with it, roots of the integrated
        distribution function of the sum, to 0.001 ns. Oracle: samples, and scipy.stats where it has the sum.
        """
        points = np.array(list(ps), dtype=np.float64)
        quantiles_ns = self.delay.quantile_ns(points)
        jitter = self.jitter
        if jitter is None or jitter.reach_ns == 0.0:
            return [float(quantile_ns) for quantile_ns in quantiles_ns]
        return [self._quantile_ns(jitter, float(p), float(q)) for p, q in zip(points, quantiles_ns, strict=True)]

    def shares_ns(self, n: int) -> Floats:
        """Return the delays in ns, (n,), in the middle of ``n`` equal shares, ascending.

        With jitter they are taken from the sums of ``n`` delays with `_N_DEVIATIONS` deviations each, as mixtures of
        many laws need more quantiles than can be integrated. Each delay has other deviations, by the golden section,
        so that equal delays have not the same few. Oracle: `quantiles_ns`.
        """
        delays_ns = self.delay.quantile_ns((np.arange(n) + 0.5) / n)
        if self.jitter is None or self.jitter.reach_ns == 0.0:
            return delays_ns
        within = np.mod((np.arange(n) + 0.5) * _GOLDEN, 1.0)
        shares = (np.arange(_N_DEVIATIONS) + within[:, None]) / _N_DEVIATIONS
        each_ns = np.repeat(delays_ns, _N_DEVIATIONS)
        sums_ns = np.sort(each_ns + self.jitter.quantile_ns(shares.ravel(), each_ns))
        return np.asarray(sums_ns[_N_DEVIATIONS // 2 :: _N_DEVIATIONS])

    def _quantile_ns(self, jitter: Jitter, p: float, about_ns: float) -> float:
        """Return a quantile of the sum: within the jitter's reach of the delay's own quantile."""
        reach_ns, bends_ns = jitter.reach_ns, jitter.bends_ns

        def excess(x_ns: float) -> float:
            places_ns = np.concatenate([bends_ns, x_ns - bends_ns, x_ns + bends_ns])
            return self.delay.expect(lambda delay_ns: jitter.cdf(x_ns - delay_ns, delay_ns), places_ns) - p

        return root(excess, max(about_ns - reach_ns, 0.0), about_ns + reach_ns, _WIDTH_NS)

    def _shift_ns(self) -> float:
        """Return the jitter's mean: above 0 where deviations are redrawn."""
        jitter = self.jitter
        if jitter is None:
            return 0.0
        return self.delay.expect(lambda delay_ns: jitter.moments_ns(delay_ns)[0], jitter.bends_ns)


def root(f: Callable[[float], float], low: float, high: float, width: float) -> float:
    """Return an x in [low, high] within ``width`` of a root of a continuous ``f`` that does not fall.

    ``f`` is at most 0 at ``low`` and at least 0 at ``high``. False position with the Illinois weights (Dowell,
    Jarratt 1971); every third step bisects, so that it converges for any ``f``. Oracle: known roots in the tests.
    """
    f_low, f_high = f(low), f(high)
    side = 0
    for step in range(_MAX_STEPS):
        if high - low <= width or f_low >= 0.0 or f_high <= 0.0:
            break
        x = (low + high) / 2.0 if step % 3 == 2 else (low * f_high - high * f_low) / (f_high - f_low)
        if not low < x < high:  # rounding
            x = (low + high) / 2.0
        f_x = f(x)
        if f_x == 0.0:
            return x
        # an end that stays twice in a row gets half its weight, which pulls the next x towards it
        if f_x < 0.0:
            low, f_low = x, f_x
            f_high = f_high / 2.0 if side < 0 else f_high
            side = -1
        else:
            high, f_high = x, f_x
            f_low = f_low / 2.0 if side > 0 else f_low
            side = 1
    return low if f_low >= 0.0 else high if f_high <= 0.0 else (low + high) / 2.0
