"""The part of a model file that `drmf` reads."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from tis.patient_side.completion_model import CompletionModel, Factorisation
from tis.patient_side.identification.model_part import Matrix, Number, Part, check_covariance

NotNegative = Annotated[Number, Field(ge=0)]


class FactorisationPart(Part):
    """Mirrors `Factorisation`."""

    rank: Annotated[int, Field(ge=1)]
    ridge: NotNegative
    n_outliers: Annotated[int, Field(ge=0)]
    least_outlier_m: NotNegative
    least_noise_m2: Annotated[Number, Field(gt=0)]
    tolerance_m: NotNegative
    max_turns: Annotated[int, Field(ge=1, le=100)]


class CompletionPart(Part):
    """Mirrors `CompletionModel`."""

    stride: Annotated[int, Field(ge=1)]
    n_columns: Annotated[int, Field(ge=1, le=1000)]
    moves_m2: Annotated[list[NotNegative], Field(min_length=3, max_length=1000)]
    prior_columns: NotNegative
    factorisation: FactorisationPart
    longest: Annotated[int, Field(ge=1)]
    horizons: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)]
    covariance_m2: list[Matrix]

    @model_validator(mode="after")
    def _sound(self) -> Self:
        wrong, n_rows = [], len(self.moves_m2)
        if self.factorisation.rank > n_rows - 2:
            wrong.append(f"factorisation.rank must be at most {n_rows - 2}, two less than moves_m2 has elements")
        if self.longest >= n_rows:
            wrong.append(f"longest must be below {n_rows}, the number of elements of moves_m2")
        if sorted(set(self.horizons)) != self.horizons:
            wrong.append("horizons must rise")
        if len(self.covariance_m2) != len(self.horizons):
            wrong.append(f"covariance_m2 must have {len(self.horizons)} elements, one for each horizon")
        if wrong:
            raise ValueError("; ".join(wrong))
        for i, covariance in enumerate(self.covariance_m2):
            check_covariance(f"covariance_m2.{i}", covariance)
        return self

    def model(self) -> CompletionModel:
        """Return the model with arrays in the place of lists."""
        return CompletionModel(
            stride=self.stride,
            n_columns=self.n_columns,
            moves_m2=np.array(self.moves_m2, dtype=float),
            prior_columns=self.prior_columns,
            factorisation=Factorisation(**self.factorisation.model_dump()),
            longest=self.longest,
            horizons=np.array(self.horizons, dtype=np.int64),
            covariance_m2=np.array(self.covariance_m2, dtype=float),
        )
