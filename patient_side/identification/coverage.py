"""Honest covariances: by how much they have to grow so that 95 % of the held-back errors lie in 95 % ellipsoids.

Real movement is now quiet and now fast, and its forecasts have heavier tails than a normal distribution: a covariance
that has the right size on average does not cover what it says.
"""

import numpy as np
from scipy.special import chdtri

from patient_side.statespace import Array

_COVERED = 0.95
_TRUSTED_WINDOWS = 10


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
