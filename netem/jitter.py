"""Jitter: a deviation that is added to a packet's delay and redrawn where the sum would be negative.

So the deviation is drawn from its distribution *given* that it is at least minus the delay. Where the delay
leaves room for the whole deviation nothing is redrawn, and mean and spread are as asked.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from common.scenario import network
from common.units import NS_PER_MS
from netem.truncated_normal import Floats, moments_above, quantile_above


class Jitter(Protocol):
    """A deviation from the delay, in ns."""

    def quantile_ns(self, u: Floats, delay_ns: Floats) -> Floats:
        """Return the deviation that each uniform stands for beside its delay, both of shape (N,)."""
        ...

    def moments_ns(self, delay_ns: float) -> tuple[float, float]:
        """Return the deviation's mean (ns) and variance (ns^2) beside one delay."""
        ...


@dataclass(frozen=True)
class NormalJitter:
    """Normal with mean 0, above minus the delay."""

    std_ns: float

    def quantile_ns(self, u: Floats, delay_ns: Floats) -> Floats:
        """Return the deviations, (N,)."""
        return quantile_above(u, 0.0, self.std_ns, -delay_ns)

    def moments_ns(self, delay_ns: float) -> tuple[float, float]:
        """Return the deviation's mean (ns) and variance (ns^2) beside one delay."""
        return moments_above(0.0, self.std_ns, -delay_ns)


@dataclass(frozen=True)
class UniformJitter:
    """Uniform between plus and minus ``half_width_ns``, above minus the delay."""

    half_width_ns: float

    def quantile_ns(self, u: Floats, delay_ns: Floats) -> Floats:
        """Return the deviations, (N,)."""
        low = np.maximum(-self.half_width_ns, -delay_ns)
        return np.asarray(low + u * (self.half_width_ns - low))

    def moments_ns(self, delay_ns: float) -> tuple[float, float]:
        """Return the deviation's mean (ns) and variance (ns^2) beside one delay."""
        low = max(-self.half_width_ns, -delay_ns)
        return (low + self.half_width_ns) / 2.0, (self.half_width_ns - low) ** 2 / 12.0


def build_jitter(part: network.NormalJitter | network.UniformJitter) -> Jitter:
    """Return the jitter that a scenario asks for."""
    if isinstance(part, network.NormalJitter):
        return NormalJitter(part.std_ms * NS_PER_MS)
    return UniformJitter(part.half_width_ms * NS_PER_MS)
