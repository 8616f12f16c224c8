"""The parts of a model file's schema: their types, and checks of shapes."""

from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

AXES = 3

Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = list[Number]
Matrix = list[list[Number]]
Axes = Annotated[Vector, Field(min_length=AXES, max_length=AXES)]


class Part(BaseModel):
    """A part of a model file: no unknown or missing keys, arrays of the right shape."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


def check_covariance(name: str, matrix: Matrix, axes: int = AXES) -> None:
    """Raise `ValueError` where a matrix is no covariance of the axes: (axes, axes), symmetric, positive definite."""
    R = np.array(matrix)
    if not has_shape(matrix, (axes, axes)) or not np.array_equal(R, R.T) or np.linalg.eigvalsh(R)[0] <= 0:
        raise ValueError(f"{name} must be symmetric and positive definite")


def has_shape(matrix: Matrix, shape: tuple[int, int]) -> bool:
    """Tell whether a matrix has a shape."""
    return len(matrix) == shape[0] and all(len(row) == shape[1] for row in matrix)
