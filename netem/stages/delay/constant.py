"""Constant delay."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from tis.netem.draws.blocks import Floats


@dataclass(frozen=True)
class ConstantDelay:
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
