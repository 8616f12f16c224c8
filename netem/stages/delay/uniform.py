"""Uniform delay."""

from dataclasses import dataclass

import numpy as np

from tis.netem.draws.blocks import Floats
from tis.netem.stages.delay.law import ContinuousDelay


@dataclass(frozen=True)
class UniformDelay(ContinuousDelay):
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
