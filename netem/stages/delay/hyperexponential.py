"""A mixture of exponential distributions, each with a weight and a mean."""

from dataclasses import dataclass
from math import log
from typing import Final

import numpy as np
import scipy

from tis.netem.draws.blocks import Floats

_PRECISION: Final = 1e-13
_ROUNDING: Final = 1e-15  # of ln P(X > x), which bounds the accuracy of a step
_MAX_STEPS: Final = 100


@dataclass(frozen=True)
class Hyperexponential:
    """Exponential distributions with ``means_ns``, each chosen with its weight; the weights sum to 1."""

    weights: tuple[float, ...]
    means_ns: tuple[float, ...]

    def quantile_ns(self, p: Floats) -> Floats:
        """Return the quantiles, shape of ``p``, by Newton's method.

        ln P(X > x) is convex and decreasing in x, so Newton's steps from below the root increase x and never pass
        the root; where one exponential dominates, one step suffices (oracle: bisection, test_hyperexponential).
        """
        parts = list(zip(self.weights, self.means_ns, strict=True))
        goal = np.log1p(-p)
        # start below the root: P(X > x) is at least each term, and at least the exponential of the mean rate (Jensen)
        x_ns = np.asarray(-goal / sum(weight / mean_ns for weight, mean_ns in parts))
        for weight, mean_ns in parts:
            x_ns = np.maximum(x_ns, mean_ns * (log(weight) - goal))
        for _ in range(_MAX_STEPS):
            beyond, density = np.zeros(x_ns.shape), np.zeros(x_ns.shape)
            for weight, mean_ns in parts:
                term = weight * np.exp(x_ns / -mean_ns)
                beyond += term
                density += term / mean_ns
            slope_ns = beyond / density
            step_ns = (np.log(beyond) - goal) * slope_ns
            x_ns = np.maximum(x_ns + step_ns, 0.0)
            if (step_ns <= _PRECISION * x_ns + _ROUNDING * slope_ns).all():
                break
        return x_ns

    def cdf(self, x_ns: Floats) -> Floats:
        """Return P(X <= x), shape of ``x_ns``."""
        share = np.zeros(np.shape(x_ns))
        for weight, mean_ns in zip(self.weights, self.means_ns, strict=True):
            share -= weight * np.expm1(x_ns / -mean_ns)
        return share

    def moments_below(self, limit_ns: float) -> tuple[float, float]:
        """Return mean (ns) and variance (ns^2) given X <= ``limit_ns``.

        For one exponential, E[X^k; X <= m] = k! mean^k P(k + 1, m / mean), P the incomplete gamma function.
        """
        weights, means_ns = np.array(self.weights), np.array(self.means_ns)
        zeroth, first, second = (
            float((weights * factor * means_ns**k * scipy.special.gammainc(k + 1, limit_ns / means_ns)).sum())
            for k, factor in enumerate((1.0, 1.0, 2.0))
        )
        mean_ns = first / zeroth
        return mean_ns, second / zeroth - mean_ns**2
