"""The models of an arm as values, as model files hold them; the linear one is a `StateSpace`."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from tis.common.channels import Arm, Hand
from tis.common.sources.provenance import RecordedRows
from tis.patient_side.learned_model import LearnedModel
from tis.patient_side.linear_system import Array, NoiseModel, StateSpace
from tis.patient_side.model_fields import (
    AXES,
    Axes,
    Count,
    NotNegative,
    Shape,
    StoredModel,
    ThreeNumbers,
    Vector,
    lists,
    of_axes,
)
from tis.patient_side.movement_models import CompletionModel, DirectModel, InnovationsModel, InputForecast, WristModel


@dataclass(frozen=True)
class FilterModel(StoredModel):
    """A second model of an arm, for an estimator with an identification method of its own.

    Offsets (3,) and ``static`` are as in `ArmModel`.
    """

    space: StateSpace
    noise: NoiseModel
    input_offset_m: Axes
    output_offset_m: Axes
    static: bool

    def shapes(self) -> Mapping[str, Shape]:
        """Return the shapes of all matrices."""
        return _linear_shapes(self.space.order)

    def covariances(self) -> Mapping[str, Array]:
        """Return that of the measurement noise."""
        return {"noise.R": self.noise.R}


@dataclass(frozen=True)
class Movement(StoredModel):
    """How far from their mean positions were in training, how fast they moved, and how fast that changed."""

    reach_m: NotNegative
    speed_m_s: NotNegative
    acceleration_m_s2: NotNegative


@dataclass(frozen=True)
class ArmModel(StoredModel):
    """All models of one arm; written to the run folder, and read back by a replay.

    ``input_offset_m`` and ``output_offset_m`` (3,) are the operating point: means over the training rows.
    ``output_low_m`` and ``output_high_m`` (3,) are the training rows' range, the unit of normalised errors.
    ``fit_pct`` is the share of variance, per axis, that a simulation explains on the validation rows.
    ``static``: a gain is the whole relation of arm and command. ``innovations`` and the fields after it are the
    models of further estimators, ``wrist`` those of orientation and gripper; None where they could not be, or were
    not, identified. ``commanded`` is the movement of the command, and the arm's response to it, where that forecasts
    the arm better than ``innovations``, the arm's own movement.
    ``command_movement`` and ``arm_movement`` are those of the training rows, None in older files.
    ``trained_on`` are the training rows of each recording; empty in files that do not record them.
    """

    hand: Hand
    arm: Arm
    rate_hz: Count
    method: str
    order: Annotated[int, Field(ge=0)]
    block_rows: Annotated[int, Field(ge=2)]
    train: str
    space: StateSpace
    x0: Vector
    noise: NoiseModel
    forecast: InputForecast
    input_offset_m: Axes
    output_offset_m: Axes
    output_low_m: Axes
    output_high_m: Axes
    singular_values: Vector
    fit_pct: Annotated[tuple[float, ...], lists(ThreeNumbers, tuple)]
    spectral_radius: NotNegative
    pairing: str
    static: bool
    warnings: tuple[str, ...] = ()
    trained_on: tuple[RecordedRows, ...] = ()
    innovations: InnovationsModel | None = None
    commanded: InnovationsModel | None = None
    n4sid: FilterModel | None = None
    arx: FilterModel | None = None
    autoregression: InnovationsModel | None = None
    direct: Annotated[DirectModel, of_axes(AXES)] | None = None
    paper: FilterModel | None = None
    drmf: CompletionModel | None = None
    learned: tuple[LearnedModel, ...] = ()
    wrist: WristModel | None = None
    command_movement: Movement | None = None
    arm_movement: Movement | None = None

    def shapes(self) -> Mapping[str, Shape]:
        """Return the shapes of the linear model's matrices."""
        return _linear_shapes(self.order)

    def faults(self) -> Iterator[str]:
        """Yield a state that does not fit."""
        if len(self.x0) != self.order:
            yield f"x0 must have {self.order} elements, one for each state"

    def covariances(self) -> Mapping[str, Array]:
        """Return that of the measurement noise."""
        return {"noise.R": self.noise.R}

    @property
    def n_lags(self) -> int | None:
        """Return the number of lags of a regression (method arx); None of other models."""
        return self.order // self.space.n_outputs if self.method == "arx" else None


def _linear_shapes(n: int) -> Mapping[str, Shape]:
    """Return the shapes of a linear model's matrices with ``n`` states."""
    return {
        "space.A": (n, n),
        "space.B": (n, AXES),
        "space.C": (AXES, n),
        "space.D": (AXES, AXES),
        "noise.Q": (n, n),
        "noise.R": (AXES, AXES),
        "noise.S": (n, AXES),
    }


def order_text(model: ArmModel) -> str:
    """Return the order as text, for a regression with its number of lags and outputs."""
    return (
        str(model.order) if model.n_lags is None else f"{model.order} ({model.n_lags} lags x {model.space.n_outputs})"
    )


def with_model(model: ArmModel, own: FilterModel) -> ArmModel:
    """Return the arm with another model of its movement, which starts at that model's operating point."""
    order = own.space.order
    return replace(
        model,
        order=order,
        space=own.space,
        x0=np.zeros(order),
        noise=own.noise,
        input_offset_m=own.input_offset_m,
        output_offset_m=own.output_offset_m,
        spectral_radius=own.space.spectral_radius(),
        static=own.static,
    )
