"""Calibration on held-out errors, by age: the share of the means that they support, and the covariances."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.identification.coverage import coverage_factor
from tis.patient_side.learned.inputs import has_gap
from tis.patient_side.learning.examples import Examples
from tis.patient_side.model_fields import Floats

AGES: Final = np.array([1.0, 3.0, 6.0, 15.0, 30.0, 60.0, 150.0])
"""Ages, in steps, at which the factors are known."""


def nearest_age(ages: Floats) -> NDArray[np.intp]:
    """Return for each of ``ages`` (B, K) which of `AGES` is nearest, on a logarithmic scale."""
    return np.asarray(np.argmin(np.abs(np.log(ages)[:, :, None] - np.log(AGES)), axis=2))


def mean_share(mean: Floats, held: Examples) -> Floats:
    """Return the shares (A,) of held-out means (B, K, 3), in units of the examples, at `AGES`: between 0 and 1.

    A share is the least-squares factor for the forecasts nearest in age, in m, so that what was learned by heart is
    not used. Oracle: means that are the truth, twice the truth, and noise.
    """
    nearest, weights = nearest_age(held.ages).ravel(), held.unit_m.ravel() ** 2
    along, squares = (
        np.bincount(nearest, weights * np.sum(mean * other, axis=2).ravel(), minlength=len(AGES))
        for other in (held.left, mean)
    )
    return np.asarray(np.clip(along / np.maximum(squares, 1e-300), 0.0, 1.0))


def shared(mean: Floats, share: Floats, ages: Floats) -> Floats:
    """Return the means (B, K, 3) with their ``share`` (A,) at `AGES`, interpolated to ``ages`` (B, K)."""
    return np.asarray(np.interp(np.log(ages), np.log(AGES), share)[:, :, None] * mean)


def covariance_scale(errors: Floats, log_deviation: Floats, held: Examples) -> Floats:
    """Return the factors (2, A) for covariances at `AGES`, from held-out errors (B, K, 3) in units of the examples.

    The first row is for unbroken recent paths, the second for those with a gap. A factor is that of the forecasts
    nearest in age, see `coverage_factor`: with few of them it approaches 1. Oracle: normal errors of known deviation.
    """
    nearest = nearest_age(held.ages)
    broken = has_gap(held.window.present > 0)[:, None]
    standard = errors / np.exp(log_deviation)[:, :, None]
    return np.array(
        [
            [
                coverage_factor(standard[(nearest == a) & (broken == row)], np.eye(3), max(1, round(age)))
                for a, age in enumerate(AGES)
            ]
            for row in (False, True)
        ]
    )
