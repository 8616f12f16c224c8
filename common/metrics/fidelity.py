"""Whether what was drawn can be what was asked for, or chance does not explain the difference.

Every bound is that of 4 standard errors: chance alone oversteps it in 6 of 100 000 cases.
"""

from math import erfc, log, log1p, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

Floats = NDArray[np.float64]

Z: Final = 4.0
LEVEL: Final = erfc(Z / sqrt(2.0))
"""Probability that a normal number lies more than `Z` standard deviations from its mean."""

_LEAST_BATCHED: Final = 400  # 11 batches of 36


def mean_margin(std: float, skewness: float, n_effective: float) -> float:
    """Return how far the mean of ``n_effective`` > 0 independent draws may lie from that of their distribution.

    ``Z`` standard errors, widened for a skewed distribution by the first term of the Cornish-Fisher expansion,
    skewness (Z**2 - 1) / (6 sqrt(n)). Oracle: simulated gamma means, test_fidelity.
    """
    root = sqrt(n_effective)
    return (Z + (Z * Z - 1.0) * abs(skewness) / (6.0 * root)) * std / root


def share_bounds(n_hits: float, n: float, level: float = LEVEL) -> tuple[float, float]:
    """Return the shares, (low, high), that explain ``n_hits`` among ``n`` > 0 draws: each end errs at ``level`` / 2.

    Clopper and Pearson's interval, exact for independent draws; for others divide both numbers by the inflation of
    the variance. Oracle: `scipy.stats.binomtest`.
    """
    low = float(betaincinv(n_hits, n - n_hits + 1.0, level / 2)) if n_hits > 0 else 0.0
    high = float(betaincinv(n_hits + 1.0, n - n_hits, 1.0 - level / 2)) if n_hits < n else 1.0
    return low, high


def is_decidable(p: float, n: float) -> bool:
    """Tell whether ``n`` draws would show that something asked for with probability ``p`` never happens."""
    return n > 0 and (p in (0.0, 1.0) or n * log1p(-p) < log(LEVEL / 2))


def gilbert_inflation(p_loss: float, mean_burst: float) -> float:
    """Return by how much the variance of a share of losses exceeds that of independent ones, at least 1.

    (1 + rho) / (1 - rho), rho = 1 - p - r the correlation of neighbours in Gilbert's model with runs of
    ``mean_burst`` (oracle: simulated chains, test_fidelity). Infinite where everything is lost in one run.
    """
    if p_loss <= 0.0:
        return 1.0
    r = 1.0 / mean_burst
    if p_loss >= 1.0 or r == 0.0:
        return float("inf")
    rho = max(0.0, 1.0 - r - p_loss * r / (1.0 - p_loss))
    return (1.0 + rho) / (1.0 - rho)


def half_life_inflation(step_s: float, half_life_s: float) -> float:
    """Return by how much correlated draws ``step_s`` > 0 apart inflate the variance of their mean, at most.

    (1 + rho) / (1 - rho) with rho = 0.5 ** (step / half life), the correlation of the Gaussian scores: that of what
    is computed from them is never larger. Oracle: a simulated process, test_fidelity.
    """
    decay = -np.expm1(-log(2.0) * step_s / half_life_s)
    return float((2.0 - decay) / decay)


def batch_inflation(residuals: Floats, variance: float) -> float:
    """Return by how much the variance of the mean exceeds ``variance`` / N, as batches of the N residuals show it.

    At least 1, and 1 below 400 residuals. Method of batch means with batches of N ** 0.6 (oracle: a simulated
    process of known correlation, test_fidelity).
    """
    n = len(residuals)
    if n < _LEAST_BATCHED or variance <= 0.0:
        return 1.0
    size = int(n**0.6)
    means = residuals[: n // size * size].reshape(-1, size).mean(axis=1)
    return max(1.0, size * float(means.var(ddof=1)) / variance)
