"""A trained model of a learned method as a value: arrays by name, scales, and how it was trained."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Annotated, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from tis.common.scenario.estimator_names import LearnedName
from tis.patient_side.model_fields import (
    Count,
    Floats,
    NotNegative,
    Positive,
    Rising,
    Share,
    StoredModel,
    Vector,
    lists,
    rises,
)

Singles = NDArray[np.float32]
Weights = Mapping[str, Singles]

VERSION: Final = 1
"""Version of the inputs and structures of all learned methods: a model of another one cannot be used."""


@dataclass(frozen=True)
class Training(StoredModel):
    """How a model was trained.

    ``held_out`` are the people, or the stretches of rows, on which training was judged; ``errors`` (E,) are the
    errors on them after each epoch, over those of the linear forecast, of which ``n_epochs`` was the best number.
    """

    seed: Annotated[int, Field(ge=0)]
    n_rows: Count
    held_out: tuple[str, ...]
    n_epochs: Count
    errors: Vector


@dataclass(frozen=True)
class LearnedModel(StoredModel):
    """What a learned method adds to the linear forecast of the arm's own movement.

    ``usual_m`` is the usual size of an increment (rms over the training rows), ``gripper_spread_rad`` the deviation
    of the gripper's angle, 0 where it does not move. At the ages ``scale_ages`` (A,), in steps of the model,
    ``mean_share`` (A,) multiplies the means, which is how much of them held-out errors support, and
    ``covariance_scale`` (2, A) the covariances, so that 95 % ellipsoids hold 95 % of these errors: one row for
    unbroken recent paths, one for those with a gap. In a model file, ``weights`` names the tensor that holds each.
    """

    method: LearnedName
    version: int
    usual_m: Positive
    gripper_spread_rad: NotNegative
    scale_ages: Rising
    mean_share: Annotated[Floats, lists(list[Share])]
    covariance_scale: Annotated[Floats, lists(Annotated[list[list[Positive]], Field(min_length=2, max_length=2)])]
    weights: Annotated[Weights, lists(dict[str, str], dict)]
    training: Training

    def faults(self) -> Iterator[str]:
        """Yield the first reason why the scales do not fit their ages."""
        n = len(self.scale_ages)
        if not rises(self.scale_ages):
            yield "scale_ages must rise"
        elif any(len(each) != n for each in (self.mean_share, *self.covariance_scale)):
            yield "mean_share and the rows of covariance_scale must be as long as scale_ages"
