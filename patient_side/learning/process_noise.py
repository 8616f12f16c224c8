"""The noise of a Gaussian process, for each age, chosen on examples that it has not learned from."""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np

from tis.patient_side.learned.gaussian_process import AGES
from tis.patient_side.learning.examples import Examples
from tis.patient_side.model_fields import Floats

RATIOS: Final = np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 1e4, 1e6])
"""Ratios of noise to signal that are tried; the last one is practically the linear forecast."""


class Noise(NamedTuple):
    """Ratios of noise to signal (A,) at all ages, and the mean squares (A,) of the errors with them, in units."""

    ratio: Floats
    squares: Floats


def noise_on(z: Floats, mean_of: Callable[[Floats], Floats], judged: Examples) -> Noise:
    """Return, for each age, the ratio with the smallest error in m on examples that were held out.

    ``z`` (B, M) are their kernel vectors, ``mean_of`` returns the coefficients (A, M, 3) of the mean at ratios (A,).
    Oracle: noise, of which nothing can be learned.
    """
    unit_m = judged.unit_m[:, :, None]
    best, ratio, squares = np.full(len(AGES), np.inf), np.full(len(AGES), RATIOS[-1]), np.zeros(len(AGES))
    for each in RATIOS.tolist():
        errors = judged.left - np.einsum("bm,amc->bac", z, mean_of(np.full(len(AGES), each)))
        in_m2 = np.sum((unit_m * errors) ** 2, axis=(0, 2))
        better = in_m2 < best
        best, ratio = np.where(better, in_m2, best), np.where(better, each, ratio)
        squares = np.where(better, np.mean(errors**2, axis=(0, 2)), squares)
    return Noise(ratio, squares)
