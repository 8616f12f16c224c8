"""The lognormal distribution.

Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", vol. 1, chapter 14.
"""

from dataclasses import dataclass
from math import exp, log, log1p, sqrt
from typing import Self

import numpy as np
import scipy

from tis.netem.draws.blocks import Floats


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
