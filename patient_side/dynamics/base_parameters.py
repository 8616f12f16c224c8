"""Base parameters: the combinations of standard parameters that movements and torques determine."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import Stream
from tis.patient_side.dynamics.parameters import N_PARAMETERS, NAMES
from tis.patient_side.dynamics.regressor import regressor
from tis.patient_side.plant.arm_geometry import HIGH, LOW, N_JOINTS
from tis.patient_side.statespace import Array

_N_POINTS: Final = 300
_DEPENDENT: Final = 1e-9
"""Share of a column's length that is left without the columns before it, below which it depends on them."""
_SHOWN: Final = 2


@dataclass(frozen=True)
class BaseParameters:
    """The independent columns of the regressor, and the parameters that join each of them.

    ``combine`` (B, 91) gives the base parameters from standard ones; ``independent`` are the indices (B,) of the
    columns that remain, so ``Y p = Y[:, independent] (combine p)``.
    """

    independent: NDArray[np.int64]
    combine: Array

    def names(self) -> tuple[str, ...]:
        """Return each base parameter as a sum of standard ones, the longest cut."""
        return tuple(_sum_of(row, shown=_SHOWN) for row in self.combine)

    def terms(self) -> tuple[str, ...]:
        """Return each base parameter as the whole sum of standard ones."""
        return tuple(_sum_of(row, shown=len(row)) for row in self.combine)


def base_parameters() -> BaseParameters:
    """Return the arm's base parameters, found by the QR decomposition of its regressor at random states.

    Gautier, "Numerical calculation of the base inertial parameters of robots", J. Robotic Systems 8(4), 1991. The
    order of the columns decides which of several dependent ones remains: links near the tip come last, and what only
    they would add is counted with the links before them. Oracle: torques of parameters that differ and combine to the
    same, test_base_parameters.
    """
    draws = (
        Stream.named(0, "dynamics/structure").uniforms(0, 3 * _N_POINTS * N_JOINTS).reshape(3, _N_POINTS, N_JOINTS)
    )
    states = (LOW + draws[0] * (HIGH - LOW), 2.0 * draws[1] - 1.0, 20.0 * draws[2] - 10.0)
    stacked = regressor(*states).reshape(-1, N_PARAMETERS)
    lengths = np.linalg.norm(stacked, axis=0)
    seen = lengths > 0.0
    scaled = np.divide(stacked, lengths, out=np.zeros_like(stacked), where=seen)
    triangle = np.asarray(np.linalg.qr(scaled, mode="r"))
    is_base = np.abs(np.diagonal(triangle)) > _DEPENDENT
    independent, dependent = (np.flatnonzero(which).astype(np.int64) for which in (is_base, ~is_base))
    shares, *_ = np.linalg.lstsq(scaled[:, independent], scaled[:, dependent])
    combine = np.zeros((len(independent), N_PARAMETERS))
    combine[np.arange(len(independent)), independent] = 1.0
    # back to the units of the parameters
    combine[:, dependent] = shares * lengths[dependent] / lengths[independent][:, None]
    combine[np.abs(combine) < _DEPENDENT] = 0.0
    return BaseParameters(independent, combine)


def _sum_of(row: Array, shown: int) -> str:
    """Return a combination in words, the parameter with the factor 1 that names it first."""
    order = sorted(np.flatnonzero(row), key=lambda i: (abs(row[i] - 1.0) > _DEPENDENT, i))
    text = "".join(f" {'-' if row[i] < 0 else '+'} {_factor(abs(float(row[i])))}{NAMES[i]}" for i in order[:shown])
    left = len(order) - shown
    return text.removeprefix(" + ") + (f" + {left} more" if left > 0 else "")


def _factor(value: float) -> str:
    return "" if abs(value - 1.0) < _DEPENDENT else f"{value:.4g} "
