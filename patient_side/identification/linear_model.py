"""What every linear identification method returns."""

from dataclasses import dataclass

import numpy as np

from patient_side.identification.trials import Scaling
from patient_side.statespace import Array, NoiseModel, StateSpace


@dataclass(frozen=True)
class Provenance:
    """Where a model comes from: method, block rows (lags for `arx`), order, and the rows it was fitted to.

    ``singular_values`` are those that the method shows its order by, of outputs at unit deviation; for `cva`
    they are canonical correlations, and `arx` has none.
    """

    method: str
    block_rows: int
    order: int
    n_rows: int
    n_trials: int
    singular_values: Array


@dataclass(frozen=True)
class LinearModel:
    """``x[k+1] = A x + B u + w, y[k] = C x + D u + v``, noise in innovations form, in the units of the data.

    ``x0`` holds each trial's state (n,) at its first row; ``scaling`` the units in which the method worked.
    """

    space: StateSpace
    x0: tuple[Array, ...]
    noise: NoiseModel
    scaling: Scaling
    provenance: Provenance
    warnings: tuple[str, ...]

    @property
    def A(self) -> Array:  # noqa: N802  the field's name
        """State matrix (n, n)."""
        return self.space.A

    @property
    def B(self) -> Array:  # noqa: N802
        """Input matrix (n, m)."""
        return self.space.B

    @property
    def C(self) -> Array:  # noqa: N802
        """Output matrix (p, n)."""
        return self.space.C

    @property
    def D(self) -> Array:  # noqa: N802
        """Feedthrough (p, m)."""
        return self.space.D

    @property
    def K(self) -> Array:  # noqa: N802
        """Kalman gain (n, p) of the innovations form: ``w = K v``, so that ``S = K R`` and ``Q = K R K'``."""
        return np.asarray(np.linalg.solve(self.noise.R, self.noise.S.T).T)

    @property
    def Q(self) -> Array:  # noqa: N802
        """Process noise covariance (n, n)."""
        return self.noise.Q

    @property
    def R(self) -> Array:  # noqa: N802
        """Measurement noise covariance (p, p): that of the innovations."""
        return self.noise.R

    @property
    def S(self) -> Array:  # noqa: N802
        """Cross covariance (n, p) of process and measurement noise."""
        return self.noise.S
