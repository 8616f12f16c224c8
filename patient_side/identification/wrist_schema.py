"""The schema of the models for least squares and of those of orientation and gripper."""

from typing import Annotated, ClassVar, Self

from pydantic import Field, model_validator

from tis.patient_side.identification.model_part import AXES, Matrix, Number, Part, check_covariance, has_shape


class DirectPart(Part):
    """Mirrors `DirectModel`, of a signal with three axes."""

    axes: ClassVar[int] = AXES

    stride: Annotated[int, Field(ge=1)]
    lags: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)]
    horizons: Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1)]
    past: Matrix
    cross: list[Matrix]
    future: list[Matrix]
    n_lags: list[Annotated[int, Field(ge=1)]]
    penalty: list[Annotated[Number, Field(gt=0)]]
    covariance_scale: list[Annotated[Number, Field(gt=0)]]

    @model_validator(mode="after")
    def _sound(self) -> Self:
        d, n_horizons = self.axes * len(self.lags), len(self.horizons)
        wrong = []
        if not has_shape(self.past, (d, d)):
            wrong.append(f"past must have the shape {(d, d)}")
        for name, matrices, shape in (
            ("cross", self.cross, (d, self.axes)),
            ("future", self.future, (self.axes, self.axes)),
        ):
            if len(matrices) != n_horizons or not all(has_shape(matrix, shape) for matrix in matrices):
                wrong.append(f"{name} must have the shape {(n_horizons, *shape)}")
        wrong += [
            f"{name} must have {n_horizons} elements, one for each horizon"
            for name in ("n_lags", "penalty", "covariance_scale")
            if len(getattr(self, name)) != n_horizons
        ]
        if sorted(set(self.lags)) != self.lags or sorted(set(self.horizons)) != self.horizons:
            wrong.append("lags and horizons must rise")
        if max(self.n_lags, default=1) > len(self.lags):
            wrong.append(f"n_lags must be at most {len(self.lags)}, the number of lags")
        if wrong:
            raise ValueError("; ".join(wrong))
        return self


class GripperDirectPart(DirectPart):
    """Mirrors `DirectModel`, of a signal with one axis."""

    axes: ClassVar[int] = 1


class RatePart(Part):
    """Mirrors `RateModel`, of a signal with three axes."""

    axes: ClassVar[int] = AXES

    stride: Annotated[int, Field(ge=1)]
    damping: Annotated[Number, Field(ge=0, le=1)]
    velocity_span: Annotated[int, Field(ge=1)]
    horizons: Annotated[list[Annotated[Number, Field(gt=0)]], Field(min_length=1)]
    covariance: list[Matrix]

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if len(self.covariance) != len(self.horizons):
            raise ValueError("covariance must be as long as horizons")
        if sorted(set(self.horizons)) != self.horizons:
            raise ValueError("horizons must rise")
        for covariance in self.covariance:
            check_covariance("covariance", covariance, self.axes)
        return self


class GripperRatePart(RatePart):
    """Mirrors `RateModel`, of a signal with one axis."""

    axes: ClassVar[int] = 1


class WristPart(Part):
    """Mirrors `WristModel`."""

    rate: RatePart | None = None
    gripper_rate: GripperRatePart | None = None
    direct: DirectPart | None = None
    gripper_direct: GripperDirectPart | None = None

    @model_validator(mode="after")
    def _sound(self) -> Self:
        if (self.rate is None) != (self.gripper_rate is None):
            raise ValueError("rate and gripper_rate must both be given, or neither")
        if (self.direct is None) != (self.gripper_direct is None):
            raise ValueError("direct and gripper_direct must both be given, or neither")
        if self.direct and self.gripper_direct:
            one, other = self.direct, self.gripper_direct
            if (one.stride, one.lags) != (other.stride, other.lags):
                raise ValueError("direct and gripper_direct must have the same stride and lags")
        return self
