"""The gamma distribution.

Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", vol. 1, chapter 17.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
import scipy

from tis.netem.draws.blocks import Floats


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
