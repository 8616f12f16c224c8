"""Jitter: a deviation added to a packet's delay, redrawn while the sum is negative.

So the deviation has its distribution conditioned on being at least minus the delay. Where the delay exceeds every
deviation nothing is redrawn, and mean and spread are the requested ones.
"""

from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np

from tis.common.scenario.network import delay as network
from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Floats
from tis.netem.stages.delay.truncated_normal import MIN_STD_NS, cdf_above, moments_above, quantile_above

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
