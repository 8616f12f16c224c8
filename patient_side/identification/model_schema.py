"""The schema of model files: types, ranges and shapes of every part."""

from collections.abc import Sequence
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from tis.common.channels import Arm, Hand
from tis.common.scenario.estimator_names import LearnedName
from tis.patient_side.filters.correction import N_PARTS, N_TERMS
from tis.patient_side.filters.recent_past import MEANS_S
from tis.patient_side.identification.completion_schema import CompletionPart
from tis.patient_side.identification.model_part import (
    AXES,
    Axes,
    Matrix,
    Number,
    Part,
    Vector,
    check_covariance,
    has_shape,
)
from tis.patient_side.identification.wrist_schema import DirectPart, WristPart
from tis.patient_side.statespace import max_damping


class SpacePart(Part):
    """Mirrors `StateSpace`."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


class NoisePart(Part):
    """Mirrors `NoiseModel`."""

    Q: Matrix
    R: Matrix
    S: Matrix


class ForecastPart(Part):
    """Mirrors `InputForecast`."""

    damping: Annotated[Number, Field(ge=0, le=1)]
    velocity_span: Annotated[int, Field(ge=1)]
    growth_m: Annotated[list[Axes], Field(min_length=1)]
    persistence: Annotated[Number, Field(gt=0.5, le=1)] = 1.0

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if self.damping > max_damping(self.persistence):
            raise ValueError("damping must be at most 2 persistence - 1 where persistence is below 1")
        return self


class FilterPart(Part):
    """Mirrors `FilterModel`."""

    space: SpacePart
    noise: NoisePart
    input_offset_m: Axes
    output_offset_m: Axes
    static: bool

    @model_validator(mode="after")
    def _sound(self) -> Self:
        _check_shapes(self.space, self.noise, len(self.space.A))
        return self


class CorrectionPart(Part):
    """Mirrors `Correction`."""

    span: Annotated[int, Field(ge=1)]
    usual_m: Annotated[Number, Field(gt=0)]
    lowest: Number
    highest: Number
    largest: Annotated[Number, Field(gt=0)]
    gripper_usual_rad: Number
    gripper_spread_rad: Annotated[Number, Field(ge=0)]
    clock: Annotated[Number, Field(ge=0, le=0.5)]
    horizons: Annotated[list[Annotated[Number, Field(gt=0)]], Field(min_length=1)]
    weights: list[Matrix]
    widths: list[Annotated[Number, Field(gt=0)]]
    centre: Vector
    deviation: list[Annotated[Number, Field(gt=0)]]
    fourier: list[Matrix]
    linear_scale: list[Annotated[Number, Field(gt=0)]]

    @model_validator(mode="after")
    def _sound(self) -> Self:
        wrong = []
        n_features = len(self.fourier[0][0]) if self.fourier and self.fourier[0] else 0
        for name, matrices, shape in (
            ("weights", self.weights, (N_PARTS, N_TERMS)),
            ("fourier", self.fourier, (AXES, n_features)),
        ):
            if len(matrices) != len(self.horizons) or not all(has_shape(each, shape) for each in matrices):
                wrong.append(f"{name} must have the shape {(len(self.horizons), *shape)}")
        if len(self.widths) != len(MEANS_S):
            wrong.append(f"widths must have {len(MEANS_S)} elements, one for each running mean")
        n_inputs = AXES * len(MEANS_S) + 2
        if len(self.centre) != n_inputs or len(self.deviation) != n_inputs:
            wrong.append(f"centre and deviation must have {n_inputs} elements, one for each input of the features")
        if len(self.linear_scale) != len(self.horizons):
            wrong.append("linear_scale must be as long as horizons")
        if sorted(set(self.horizons)) != self.horizons:
            wrong.append("horizons must rise")
        if self.lowest > self.highest:
            wrong.append("lowest must be at most highest")
        if wrong:
            raise ValueError("; ".join(wrong))
        return self


class InnovationsPart(Part):
    """Mirrors `InnovationsModel`."""

    A: Matrix
    C: Matrix
    K: Matrix
    Re: Matrix
    level_step: Annotated[Number, Field(gt=0)]
    block_rows: Annotated[int, Field(ge=1)]
    singular_values: Vector
    scale_horizons: Annotated[Vector, Field(min_length=1)]
    covariance_scale: Annotated[Vector, Field(min_length=1)]
    integrated: bool = False
    isotropic: bool = False
    correction: CorrectionPart | None = None

    @model_validator(mode="after")
    def _sound(self) -> Self:
        n = len(self.A)
        shapes = (("A", self.A, (n, n)), ("C", self.C, (AXES, n)), ("K", self.K, (n, AXES)))
        wrong = [
            f"{name} must have the shape {shape}" for name, matrix, shape in shapes if not has_shape(matrix, shape)
        ]
        if len(self.covariance_scale) != len(self.scale_horizons):
            wrong.append("covariance_scale must be as long as scale_horizons")
        if wrong:
            raise ValueError("; ".join(wrong))
        check_covariance("Re", self.Re)
        return self


class RowsPart(Part):
    """Mirrors `RecordedRows`."""

    label: str
    digest: str
    first_row: Annotated[int, Field(ge=0)]
    n_rows: Annotated[int, Field(ge=1)]
    rate_hz: Annotated[int, Field(ge=1)]


class TrainingPart(Part):
    """Mirrors `Training`."""

    seed: Annotated[int, Field(ge=0)]
    n_rows: Annotated[int, Field(ge=1)]
    held_out: list[str]
    n_epochs: Annotated[int, Field(ge=1)]
    errors: Vector


class LearnedPart(Part):
    """Mirrors `LearnedModel`; ``weights`` names the tensor of the file that holds an array."""

    method: LearnedName
    version: int
    usual_m: Annotated[Number, Field(gt=0)]
    gripper_spread_rad: Annotated[Number, Field(ge=0)]
    scale_ages: Annotated[list[Annotated[Number, Field(gt=0)]], Field(min_length=1)]
    mean_share: list[Annotated[Number, Field(ge=0, le=1)]]
    covariance_scale: Annotated[list[list[Annotated[Number, Field(gt=0)]]], Field(min_length=2, max_length=2)]
    weights: dict[str, str]
    training: TrainingPart

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if sorted(set(self.scale_ages)) != self.scale_ages:
            raise ValueError("scale_ages must rise")
        if any(len(each) != len(self.scale_ages) for each in (self.mean_share, *self.covariance_scale)):
            raise ValueError("mean_share and the rows of covariance_scale must be as long as scale_ages")
        return self


class ModelPart(Part):
    """Mirrors `ArmModel` field by field."""

    hand: Hand
    arm: Arm
    rate_hz: Annotated[int, Field(ge=1)]
    method: str
    order: Annotated[int, Field(ge=0)]
    block_rows: Annotated[int, Field(ge=2)]
    train: str
    space: SpacePart
    x0: Vector
    noise: NoisePart
    forecast: ForecastPart
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
    trained_on: Annotated[list[RowsPart], Field(default_factory=list)]
    innovations: InnovationsPart | None = None
    n4sid: FilterPart | None = None
    arx: FilterPart | None = None
    autoregression: InnovationsPart | None = None
    direct: DirectPart | None = None
    paper: FilterPart | None = None
    drmf: CompletionPart | None = None
    learned: list[LearnedPart] = Field(default=[])
    wrist: WristPart | None = None

    @model_validator(mode="after")
    def _sound(self) -> Self:
        wrong = [] if len(self.x0) == self.order else [f"x0 must have {self.order} elements, one for each state"]
        _check_shapes(self.space, self.noise, self.order, wrong)
        return self


class ModelFile(Part):
    """A whole file."""

    version: Literal[1]
    models: Annotated[list[ModelPart], Field(min_length=1, max_length=2)]

    @model_validator(mode="after")
    def _hands_differ(self) -> Self:
        hands = [model.hand for model in self.models]
        if len(set(hands)) < len(hands):
            raise ValueError(f"models must be of different hands, not twice {hands[0]}")
        return self


def _check_shapes(space: SpacePart, noise: NoisePart, n: int, wrong: Sequence[str] = ()) -> None:
    """Raise `ValueError` with the faults ``wrong`` so far and every matrix that does not fit ``n`` states."""
    shapes = (
        ("space.A", space.A, (n, n)),
        ("space.B", space.B, (n, AXES)),
        ("space.C", space.C, (AXES, n)),
        ("space.D", space.D, (AXES, AXES)),
        ("noise.Q", noise.Q, (n, n)),
        ("noise.R", noise.R, (AXES, AXES)),
        ("noise.S", noise.S, (n, AXES)),
    )
    faults = [f"{name} must have the shape {shape}" for name, matrix, shape in shapes if not has_shape(matrix, shape)]
    if faults or wrong:
        raise ValueError("; ".join([*faults, *wrong]))
    check_covariance("noise.R", noise.R)
