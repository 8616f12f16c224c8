"""Calibration of stated covariances on held-out errors, by age."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from patient_side.identification.coverage import coverage_factor
from patient_side.learned_model import Floats
from patient_side.learning.examples import Examples

AGES: Final = np.array([1.0, 3.0, 6.0, 15.0, 30.0, 60.0, 150.0])
"""Ages, in steps, at which the factors are known."""


def nearest_age(ages: Floats) -> NDArray[np.intp]:
    """Return for each of ``ages`` (B, K) which of `AGES` is nearest, on a logarithmic scale."""
    return np.asarray(np.argmin(np.abs(np.log(ages)[:, :, None] - np.log(AGES)), axis=2))


def covariance_scale(errors: Floats, log_deviation: Floats, held: Examples) -> Floats:
    """Return the factors (A,) for covariances at `AGES`, from held-out errors (B, K, 3) in units of the examples.

    A factor is that of the forecasts nearest in age, see `coverage_factor`: with few of them it approaches 1. Oracle:
    normal errors of known deviation.
    """
    nearest = nearest_age(held.ages)
    standard = errors / np.exp(log_deviation)[:, :, None]
    return np.array(
        [coverage_factor(standard[nearest == a], np.eye(3), max(1, round(age))) for a, age in enumerate(AGES)]
    )
