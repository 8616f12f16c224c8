"""A constant plus an unbounded random part; delays above a limit are redrawn.

Redrawing gives the distribution of the part conditioned on the limit. Its quantile function is the part's own at u
times the share that is kept: exact, with one uniform per delay.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, Protocol

import numpy as np

from tis.netem.draws.blocks import Floats
from tis.netem.stages.delay.law import ContinuousDelay

_MIN_RELATIVE_VARIANCE: Final = 1e-4


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
class ShiftedDelay(ContinuousDelay):
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
