"""Statistical bounds between requested and drawn quantities: beyond them chance does not explain the difference.

Every bound is 4 standard errors wide; chance alone exceeds it in 6 of 100 000 cases.
"""

from math import erfc, log, log1p, sqrt
from typing import Final

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.float64]

Z: Final = 4.0
LEVEL: Final = erfc(Z / sqrt(2.0))
"""Probability that a normal number lies more than `Z` standard deviations from its mean."""

_MIN_BATCHED: Final = 400  # 11 batches of 36


def mean_margin(std: float, skewness: float, n_effective: float) -> float:
    """Return the bound on the distance of the mean of ``n_effective`` > 0 independent draws from the expectation.

    ``Z`` standard errors, widened for a skewed distribution by the first term of the Cornish-Fisher expansion,
    skewness (Z**2 - 1) / (6 sqrt(n)). Oracle: simulated gamma means, test_fidelity.
    """
    root = sqrt(n_effective)
    return (Z + (Z * Z - 1.0) * abs(skewness) / (6.0 * root)) * std / root


def share_bounds(n_hits: float, n: float, level: float = LEVEL) -> tuple[float, float]:
    """Return the interval (low, high) of the share behind ``n_hits`` among ``n`` > 0 draws, ``level`` / 2 per end.

    Clopper and Pearson's interval, exact for independent draws; for correlated ones divide both numbers by the
    inflation of the variance. Oracle: `scipy.stats.binomtest`.
    """
    low = float(scipy.special.betaincinv(n_hits, n - n_hits + 1.0, level / 2)) if n_hits > 0 else 0.0
    high = float(scipy.special.betaincinv(n_hits + 1.0, n - n_hits, 1.0 - level / 2)) if n_hits < n else 1.0
    return low, high


def is_decidable(p: float, n: float) -> bool:
    """Tell whether ``n`` draws suffice to show that an event of requested probability ``p`` never occurs."""
    return n > 0 and (p in (0.0, 1.0) or n * log1p(-p) < log(LEVEL / 2))


def gilbert_inflation(p_loss: float, mean_burst: float) -> float:
    """Return the inflation (>= 1) of the variance of a loss share over that of independent losses.

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
    """Return the maximum inflation of the variance of a mean of correlated draws ``step_s`` > 0 apart.

    (1 + rho) / (1 - rho) with rho = 0.5 ** (step / half life), the correlation of the Gaussian scores; that of
    functions of the scores is never larger. Oracle: a simulated process, test_fidelity.
    """
    decay = -np.expm1(-log(2.0) * step_s / half_life_s)
    return float((2.0 - decay) / decay)


def batch_inflation(residuals: Floats, variance: float) -> float:
    """Return the inflation of the variance of the mean of N residuals over ``variance`` / N, by batch means.

    At least 1, and 1 below 400 residuals; batches of N ** 0.6 residuals (oracle: a simulated process of known
    correlation, test_fidelity).
    """
    n = len(residuals)
    if n < _MIN_BATCHED or variance <= 0.0:
        return 1.0
    size = int(n**0.6)
    means = residuals[: n // size * size].reshape(-1, size).mean(axis=1)
    return max(1.0, size * float(means.var(ddof=1)) / variance)
