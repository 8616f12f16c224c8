"""A trained model of a learned method as a value: arrays by name, scales, and how it was trained."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Singles = NDArray[np.float32]
Weights = Mapping[str, Singles]

VERSION: Final = 1
"""Version of the inputs and structures of all learned methods: a model of another one cannot be used."""


@dataclass(frozen=True)
class Training:
    """How a model was trained.

    ``held_out`` are the people, or the stretches of rows, on which training was judged; ``errors`` (E,) are the
    errors on them after each epoch, over those of the linear forecast, of which ``n_epochs`` was the best number.
    """

    seed: int
    n_rows: int
    held_out: tuple[str, ...]
    n_epochs: int
    errors: Floats


@dataclass(frozen=True)
class LearnedModel:
    """What a learned method adds to the linear forecast of the arm's own movement.

    ``usual_m`` is the usual size of an increment (rms over the training rows), ``gripper_spread_rad`` the deviation
    of the gripper's angle, 0 where it does not move. At the ages ``scale_ages`` (A,), in steps of the model,
    ``mean_share`` (A,) multiplies the means, which is how much of them held-out errors support, and
    ``covariance_scale`` (2, A) the covariances, so that 95 % ellipsoids hold 95 % of these errors: one row for
    unbroken recent paths, one for those with a gap.
    """

    method: str
    version: int
    usual_m: float
    gripper_spread_rad: float
    scale_ages: Floats
    mean_share: Floats
    covariance_scale: Floats
    weights: Weights
    training: Training
