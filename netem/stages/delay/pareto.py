"""The Pareto distribution of the second kind (Lomax): P(X > x) = (1 + x / scale) ** -shape.

Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", vol. 1, chapter 20. It has no mean
if the shape is at most 1 and no variance if it is at most 2; the limit, above which delays are redrawn, makes both
finite.
"""

from dataclasses import dataclass
from math import expm1, log1p

import numpy as np
import scipy

from tis.netem.draws.blocks import Floats


@dataclass(frozen=True)
class Lomax:
    """Pareto II with a tail index ``shape`` and a scale in ns."""

    shape: float
    scale_ns: float

    def quantile_ns(self, p: Floats) -> Floats:
        """Return the quantiles, shape of ``p``."""
        return np.asarray(self.scale_ns * np.expm1(-np.log1p(-p) / self.shape))

    def cdf(self, x_ns: Floats) -> Floats:
        """Return P(X <= x), shape of ``x_ns``."""
        return np.asarray(-np.expm1(-self.shape * np.log1p(x_ns / self.scale_ns)))

    def moments_below(self, limit_ns: float) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) given X <= ``limit_ns``, for any shape.

        With Y = 1 + X / scale <= e^L: E[Y^k] = a L exprel((k - a) L) / (1 - e^(-a L)), also where k = a.
        """
        length = log1p(limit_ns / self.scale_ns)
        kept = -expm1(-self.shape * length)
        first, second = (
            self.shape * length * scipy.special.exprel((np.array([1.0, 2.0]) - self.shape) * length) / kept
        )
        return float(self.scale_ns * (first - 1.0)), float(self.scale_ns**2 * (second - first**2))
