"""The result of every linear identification method."""

from dataclasses import dataclass

from tis.patient_side.identification.trials import Scaling
from tis.patient_side.statespace import Array, NoiseModel, StateSpace


@dataclass(frozen=True)
class Provenance:
    """A model's origin: method, block rows (lags for `arx`), order, and the number of rows and trials.

    ``singular_values`` are those of the method's column space, for outputs at unit deviation; for `cva` they are
    canonical correlations, and `arx` has none.
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

    ``x0`` holds each trial's state (n,) at its first row; ``scaling`` the units in which the method computed.
    """

    space: StateSpace
    x0: tuple[Array, ...]
    noise: NoiseModel
    scaling: Scaling
    provenance: Provenance
    warnings: tuple[str, ...]
