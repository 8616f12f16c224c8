"""The models of an arm as values; the linear one is x[k+1] = A x[k] + B u[k] + w, y[k] = C x[k] + D u[k] + v."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from pydantic import Field

from tis.common.channels import Arm, Hand
from tis.common.sources.provenance import RecordedRows
from tis.patient_side.learned_model import LearnedModel
from tis.patient_side.model_fields import (
    AXES,
    Axes,
    Count,
    Floats,
    Matrix,
    NotNegative,
    Shape,
    StoredModel,
    ThreeNumbers,
    Vector,
    lists,
    of_axes,
)
from tis.patient_side.movement_models import CompletionModel, DirectModel, InnovationsModel, InputForecast, WristModel

Array = Floats

_BLOCK = 32


@dataclass(frozen=True)
class StateSpace(StoredModel):
    """Matrices of shapes A (n, n), B (n, m), C (p, n), D (p, m); n may be 0: a static relation y = D u."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix

    @property
    def order(self) -> int:
        """Number of states n."""
        return len(self.A)

    @property
    def n_inputs(self) -> int:
        """Number of inputs m."""
        return int(self.D.shape[1])

    @property
    def n_outputs(self) -> int:
        """Number of outputs p."""
        return len(self.D)

    def spectral_radius(self) -> float:
        """Return the largest modulus of A's eigenvalues, 0 for a static relation."""
        return float(np.max(np.abs(np.linalg.eigvals(self.A)))) if self.order else 0.0

    def simulate(self, u: Array, x0: Array | None = None) -> Array:
        """Return the noise-free outputs (N, p) for inputs (N, m) from state ``x0`` (n,), zero by default.

        Oracle: a plain loop, test_statespace.
        """
        # Blocks of rows instead of a loop over rows: within a block the outputs are products of matrices.
        n, p, m, length = self.order, self.n_outputs, self.n_inputs, min(_BLOCK, max(1, len(u)))
        n_blocks = -(-len(u) // length)
        inputs = np.zeros((n_blocks, length * m))
        inputs.reshape(-1)[: len(u) * m] = u.reshape(-1)
        # C A^t, and the Markov parameters D, C B, C A B, ...
        powers = np.empty((length + 1, n, n))
        powers[0] = np.eye(n)
        for t in range(length):
            powers[t + 1] = self.A @ powers[t]
        observe = self.C @ powers[:length]
        markov = np.concatenate([np.zeros((length - 1, p, m)), self.D[None], (observe @ self.B)[:-1]])
        # Response to the inputs of the same block: response[t, :, j] is that of its row t to its row j.
        response = np.lib.stride_tricks.sliding_window_view(markov, length, axis=0)[:, :, :, ::-1]
        outputs = inputs @ response.transpose(3, 2, 0, 1).reshape(length * m, length * p)
        # Response to the state at the beginning of each block, which runs from block to block.
        if n:
            drives = inputs @ (powers[length - 1 :: -1] @ self.B).transpose(0, 2, 1).reshape(length * m, n)
            states = np.empty((n_blocks, n))
            x = np.zeros(n) if x0 is None else np.asarray(x0, dtype=float)
            for block, drive in enumerate(drives):
                states[block] = x
                x = powers[length] @ x + drive
            outputs += states @ observe.reshape(length * p, n).T
        return np.asarray(outputs.reshape(n_blocks * length, p)[: len(u)])


@dataclass(frozen=True)
class NoiseModel(StoredModel):
    """Covariances of process noise Q (n, n), measurement noise R (p, p) and their cross term S (n, p), SI units."""

    Q: Matrix
    R: Matrix
    S: Matrix

    @property
    def gain(self) -> Array:
        """Return the Kalman gain K (n, p) of an innovations form: ``w = K v``, so ``S = K R`` and ``Q = K R K'``."""
        return np.asarray(np.linalg.solve(self.R, self.S.T).T)


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
    not, identified.
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
