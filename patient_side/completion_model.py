"""The model of `drmf`: numbers of a robust factorisation, and what other movements say of its factors."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Factorisation:
    """Numbers of a factorisation: ``rank`` K of L, ``ridge`` of its coefficients, ``n_outliers`` e of S.

    An outlier is a position and takes all its axes and all its entries on an antidiagonal; none is below
    ``least_outlier_m``. ``least_noise_m2`` is the least noise of the ridge. The steps are taken by turns until no
    missing position moves by more than ``tolerance_m``, at most ``max_turns`` times.
    """

    rank: int
    ridge: float
    n_outliers: int
    least_outlier_m: float
    least_noise_m2: float
    tolerance_m: float
    max_turns: int


@dataclass(frozen=True)
class CompletionModel:
    """How `drmf` completes the Hankel matrix of an arm's recent positions; a step is ``stride`` samples.

    The matrix has ``n_columns`` columns of R steps. ``moves_m2`` (R,) is the mean square move of the training rows
    over 0 .. R - 1 steps, per axis, from which follow the second moments of their columns; these stand for
    ``prior_columns`` columns beside the recent ones. Nothing is forecast over more than ``longest`` steps.
    ``covariance_m2`` (H, 3, 3) is that of the forecast's error over ``horizons`` (H,) steps, on rows held out,
    widened so that 95 % ellipsoids hold 95 % of them.
    """

    stride: int
    n_columns: int
    moves_m2: Array
    prior_columns: float
    factorisation: Factorisation
    longest: int
    horizons: NDArray[np.int64]
    covariance_m2: Array

    @property
    def n_steps(self) -> int:
        """Number of steps in the matrix: R + C - 1."""
        return len(self.moves_m2) + self.n_columns - 1
