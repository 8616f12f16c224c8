"""Honest covariances: by how much they have to grow so that 95 % of new errors lie in 95 % ellipsoids.

Real movement is now quiet and now fast, and its forecasts have heavier tails than a normal distribution: a covariance
that has the right size on average does not cover what it says. A covariance that was estimated from a few
movements is moreover uncertain itself, and too small where the forecast was fitted to the same rows.
"""

import numpy as np
from scipy.special import chdtri, fdtri

from patient_side.statespace import Array

_COVERED = 0.95
_TRUSTED_WINDOWS = 10
_LEAST_FREEDOM = 5.0


def coverage_factor(errors: Array, covariance: Array, steps: int) -> float:
    """Return the factor for a covariance (3, 3) of ``errors`` (M, 3) of forecasts over ``steps`` samples.

    It is the 95 % quantile of the squared errors, in units of their covariance, over that of a chi-square of three.
    Of errors over h samples only every h-th is a new one: with ten windows the factor counts half, with few it stays
    1. Oracles in test_coverage: normal errors.
    """
    if len(errors) == 0:
        return 1.0
    squares = np.sum(errors * np.linalg.solve(covariance, errors.T).T, axis=1)
    factor = float(np.quantile(squares, _COVERED)) / float(chdtri(errors.shape[1], 1.0 - _COVERED))
    n_windows = len(errors) / steps
    return float(max(factor, 1e-3) ** (n_windows / (n_windows + _TRUSTED_WINDOWS)))


def independent_windows(n_rows: int, steps: int) -> float:
    """Return how many independent windows of ``steps`` samples say as much as all overlapping ones of these rows.

    Of a random walk, the moves over h samples from one row after another have the correlation 1 - k/h at k rows'
    distance, so the variance that is estimated from them has ``sum_k (1 - |k|/h)^2 = (2 h^2 + 1) / (3 h)`` times
    that of independent ones (Lo and MacKinlay, 1988). Oracle in test_coverage: that sum, and simulated walks.
    """
    return n_rows * 3.0 * steps / (2.0 * steps**2 + 1.0)


def prediction_factor(n_windows: float, n_free: float, *, whole: bool = True) -> float:
    """Return the factor for the residuals' second moment (3, 3) of a fit, so that 95 % of new errors lie within.

    ``n_free`` regression coefficients were fitted to each axis of ``n_windows`` independent windows: (1 + d/n) is
    the forecast's own uncertainty, 1 / (1 - d/n) the residuals' (Akaike's final prediction error, 1969), and
    Hotelling's T^2 on the n - d degrees of freedom that are left, over chi-square, that of the covariance. Fewer
    than five are taken as five, and less than a window as one. Where only the variances are estimated and not the
    ``whole`` covariance, Fisher's F stands in for Hotelling's T^2. Oracle in test_coverage: simulated regressions.
    """
    n_windows = max(n_windows, 1.0)
    freedom = max(n_windows - n_free, _LEAST_FREEDOM)
    left = freedom - 2.0 if whole else freedom
    unsure = 3.0 * freedom / left * float(fdtri(3.0, left, _COVERED))
    uncertain = (1.0 + min(n_free / n_windows, 1.0)) * n_windows / min(freedom, n_windows)
    return max(1.0, uncertain) * unsure / float(chdtri(3.0, 1.0 - _COVERED))
