"""Model files: what was identified of one or two arms as JSON, every number exact."""

import dataclasses
import json
from collections.abc import Sequence
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import ErrorDetails

from common.channels import Arm, Hand
from common.errors import DataError, Fault
from patient_side.statespace import ArmModel, Array, InputForecast, NoiseModel, StateSpace

_AXES = 3

Number = Annotated[float, Field(allow_inf_nan=False)]
Vector = list[Number]
Matrix = list[list[Number]]
Axes = Annotated[Vector, Field(min_length=_AXES, max_length=_AXES)]


class _Part(BaseModel):
    """A part of a model file: no unknown keys, no missing ones, arrays of the right shape."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)


class _Space(_Part):
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


class _Noise(_Part):
    Q: Matrix
    R: Matrix
    S: Matrix


class _Forecast(_Part):
    damping: Annotated[Number, Field(ge=0, le=1)]
    velocity_span: Annotated[int, Field(ge=1)]
    growth_m: Annotated[list[Axes], Field(min_length=1)]


class _Model(_Part):
    """Mirrors `ArmModel` field by field."""

    hand: Hand
    arm: Arm
    rate_hz: Annotated[int, Field(ge=1)]
    method: str
    order: Annotated[int, Field(ge=0)]
    block_rows: Annotated[int, Field(ge=2)]
    train: str
    space: _Space
    x0: Vector
    noise: _Noise
    forecast: _Forecast
    input_offset_m: Axes
    output_offset_m: Axes
    output_low_m: Axes
    output_high_m: Axes
    singular_values: Vector
    fit_pct: Axes
    spectral_radius: Annotated[Number, Field(ge=0)]
    pairing: str
    static: bool
    warnings: list[str]

    @model_validator(mode="after")
    def _sound(self) -> Self:
        n = self.order
        wrong = [
            f"{name} must have the shape {shape}"
            for name, matrix, shape in (
                ("space.A", self.space.A, (n, n)),
                ("space.B", self.space.B, (n, _AXES)),
                ("space.C", self.space.C, (_AXES, n)),
                ("space.D", self.space.D, (_AXES, _AXES)),
                ("noise.Q", self.noise.Q, (n, n)),
                ("noise.R", self.noise.R, (_AXES, _AXES)),
                ("noise.S", self.noise.S, (n, _AXES)),
            )
            if not _has_shape(matrix, shape)
        ]
        if len(self.x0) != n:
            wrong.append(f"x0 must have {n} elements, one for each state")
        if wrong:
            raise ValueError("; ".join(wrong))
        R = np.array(self.noise.R)
        if not np.array_equal(R, R.T) or np.linalg.eigvalsh(R)[0] <= 0:
            raise ValueError("noise.R must be symmetric and positive definite")
        return self


class _ModelFile(_Part):
    version: Literal[1]
    models: Annotated[list[_Model], Field(min_length=1, max_length=2)]

    @model_validator(mode="after")
    def _hands_differ(self) -> Self:
        hands = [model.hand for model in self.models]
        if len(set(hands)) < len(hands):
            raise ValueError(f"models must be of different hands, not twice {hands[0]}")
        return self


def dump_models(models: Sequence[ArmModel]) -> str:
    """Return the JSON text of one or two models; `parse_models` of it gives every number back bit for bit."""
    plain = {"version": 1, "models": [_plain(dataclasses.asdict(model)) for model in models]}
    return _ModelFile.model_validate(plain).model_dump_json(indent=1) + "\n"


def parse_models(text: str, where: str) -> tuple[ArmModel, ...]:
    """Return the models of a file's text; raises `DataError` with every fault; ``where`` names the file."""
    try:
        raw = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DataError(Fault(where, "", f"must be JSON: {error}")) from None
    try:
        file = _ModelFile.model_validate(raw)
    except ValidationError as error:
        raise DataError([_fault(detail, where) for detail in error.errors()]) from None
    return tuple(_arm_model(model) for model in file.models)


def _has_shape(matrix: Matrix, shape: tuple[int, int]) -> bool:
    return len(matrix) == shape[0] and all(len(row) == shape[1] for row in matrix)


def _plain(value: object) -> object:
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return list(value)
    return value


def _arm_model(model: _Model) -> ArmModel:
    n = model.order
    rest = model.model_dump(exclude={"space", "noise", "forecast", "fit_pct", "warnings"})
    vectors = {key: np.array(item, dtype=float) for key, item in rest.items() if isinstance(item, list)}
    space, noise, forecast = model.space, model.noise, model.forecast
    return ArmModel(
        **{**rest, **vectors},
        space=StateSpace(
            _array(space.A, n, n),
            _array(space.B, n, _AXES),
            _array(space.C, _AXES, n),
            _array(space.D, _AXES, _AXES),
        ),
        noise=NoiseModel(_array(noise.Q, n, n), _array(noise.R, _AXES, _AXES), _array(noise.S, n, _AXES)),
        forecast=InputForecast(forecast.damping, forecast.velocity_span, np.array(forecast.growth_m)),
        fit_pct=tuple(model.fit_pct),
        warnings=tuple(model.warnings),
    )


def _array(rows: Matrix, n_rows: int, n_columns: int) -> Array:
    """Return the matrix with its shape, which nested lists lose where a dimension is 0."""
    return np.array(rows, dtype=float).reshape(n_rows, n_columns)


def _fault(detail: ErrorDetails, where: str) -> Fault:
    field = ".".join(str(step) for step in detail["loc"])
    rule = detail["msg"].removeprefix("Value error, ").removeprefix("Input ").replace("should", "must")
    if isinstance(detail["input"], dict | BaseModel):
        return Fault(where, field, rule)
    return Fault(where, field, rule, detail["input"])
