"""The linear model of an arm: x[k+1] = A x[k] + B u[k] + w, y[k] = C x[k] + D u[k] + v, about an operating point."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from common.channels import Arm, Hand

Array = NDArray[np.float64]


@dataclass(frozen=True)
class StateSpace:
    """Matrices of shapes A (n, n), B (n, m), C (p, n), D (p, m); n may be 0: a static relation y = D u."""

    A: Array
    B: Array
    C: Array
    D: Array

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
        """Return the noise-free outputs (N, p) for inputs (N, m) from state ``x0`` (n,), zero when not given."""
        x = np.zeros(self.order) if x0 is None else np.asarray(x0, dtype=float)
        states = np.empty((len(u), self.order))
        for k, drive in enumerate(u @ self.B.T):
            states[k] = x
            x = self.A @ x + drive
        return np.asarray(states @ self.C.T + u @ self.D.T)


@dataclass(frozen=True)
class NoiseModel:
    """Covariances of process noise Q (n, n), measurement noise R (p, p) and their cross term S (n, p), SI units."""

    Q: Array
    R: Array
    S: Array


@dataclass(frozen=True)
class InputForecast:
    """How a command continues when it has not arrived: ``u + v (phi + phi^2 + ... + phi^h)``, damped velocity.

    ``velocity_span`` is the number of samples over which v is taken. ``growth_m`` (H, 3) is the standard deviation
    of the forecast's error per axis, h = 1..H samples ahead, as found on the training rows.
    """

    damping: float
    velocity_span: int
    growth_m: Array


@dataclass(frozen=True)
class ArmModel:
    """All that the patient knows of one arm; written to the run folder, and read back by a replay.

    ``input_offset_m`` and ``output_offset_m`` (3,) are the operating point: means over the training rows.
    ``output_low_m`` and ``output_high_m`` (3,) are the training rows' range, the unit of normalised errors.
    ``fit_pct`` is the share of variance, per axis, that a simulation explains on the validation rows.
    """

    hand: Hand
    arm: Arm
    rate_hz: int
    method: str
    order: int
    block_rows: int
    train: str
    space: StateSpace
    x0: Array
    noise: NoiseModel
    forecast: InputForecast
    input_offset_m: Array
    output_offset_m: Array
    output_low_m: Array
    output_high_m: Array
    singular_values: Array
    fit_pct: tuple[float, ...]
    spectral_radius: float
    pairing: str
    static: bool
    warnings: tuple[str, ...] = field(default=())
