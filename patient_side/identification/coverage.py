"""Calibration of covariances: the factor by which 95 % of new errors lie in 95 % ellipsoids.

Real movement alternates between quiet and fast, and forecast errors have heavier tails than a normal distribution: a
covariance of the right average size covers less than it states. A covariance estimated from a few movements is also
uncertain itself, and too small where the forecast was fitted to the same rows.
"""

import numpy as np
from scipy.special import chdtri, fdtri

from tis.patient_side.linear_system import Array

_COVERED = 0.95
_HALF_WEIGHT_WINDOWS = 10
_MIN_FREEDOM = 5.0


def coverage_factor(errors: Array, covariance: Array, steps: int) -> float:
    """Return the factor for a covariance (d, d) of ``errors`` (M, d) of forecasts over ``steps`` samples.

    It is the 95 % quantile of the squared errors, in units of their covariance, over that of a chi-square with d
    degrees of freedom. Only every h-th of the errors over h samples is independent: with ten windows the factor has
    half its weight, with few it approaches 1. Oracles in test_coverage: normal errors.
    """
    if len(errors) == 0:
        return 1.0
    squares = np.sum(errors * np.linalg.solve(covariance, errors.T).T, axis=1)
    factor = float(np.quantile(squares, _COVERED)) / float(chdtri(errors.shape[1], 1.0 - _COVERED))
    n_windows = len(errors) / steps
    return float(max(factor, 1e-3) ** (n_windows / (n_windows + _HALF_WEIGHT_WINDOWS)))


def independent_windows(n_rows: int, steps: int) -> float:
    """Return the number of independent windows of ``steps`` samples as informative as all overlapping ones.

    The moves of a random walk over h samples, from successive rows, have the correlation 1 - k/h at k rows' distance,
    so that a variance estimated from them has ``sum_k (1 - |k|/h)^2 = (2 h^2 + 1) / (3 h)`` times the variance of one
    from independent moves (Lo and MacKinlay, 1988). Oracle in test_coverage: that sum, and simulated walks.
    """
    return n_rows * 3.0 * steps / (2.0 * steps**2 + 1.0)


def prediction_factor(n_windows: float, n_free: float, *, whole: bool = True, axes: int = 3) -> float:
    """Return the factor for the residuals' second moment of a fit, so that 95 % of new errors lie within.

    The moment is (p, p), with p ``axes``.
    ``n_free`` regression coefficients, d, were fitted to each axis of ``n_windows`` independent windows, n: (1 + d/n)
    accounts for the forecast's own uncertainty, 1 / (1 - d/n) for the residuals' (Akaike's final prediction error,
    1969), and Hotelling's T^2 with the remaining n - d degrees of freedom (at least five), over chi-square, for the
    covariance's. At least one window is assumed. Where only the variances are estimated and not the ``whole``
    covariance, Fisher's F replaces Hotelling's T^2. Oracle in test_coverage: simulated regressions.
    """
    n_windows = max(n_windows, 1.0)
    freedom = max(n_windows - n_free, _MIN_FREEDOM)
    left = freedom - axes + 1.0 if whole else freedom
    unsure = axes * freedom / left * float(fdtri(float(axes), left, _COVERED))
    uncertain = (1.0 + min(n_free / n_windows, 1.0)) * n_windows / min(freedom, n_windows)
    return max(1.0, uncertain) * unsure / float(chdtri(float(axes), 1.0 - _COVERED))
