"""The dynamics of the simulated arm, identified on some movements and validated on others."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.patient import MujocoPlant
from tis.common.streams import Stream
from tis.patient_side.dynamics.consistent_fit import consistent_fit
from tis.patient_side.dynamics.excitation import excitation
from tis.patient_side.dynamics.parameters import BaseParameters, base_parameters, true_parameters
from tis.patient_side.dynamics.readings import Equations, clean_equations, equations, read
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import INSERTION, N_JOINTS
from tis.patient_side.plant.physics import ArmPhysics

N_TRAINING: Final = 3
N_VALIDATION: Final = 2
DURATION_S: Final = 22.0
DETERMINED: Final = 0.02
"""Largest standard deviation of a base parameter that movements determine, as a share of its size."""
_FINEST: Final = 1e-7
"""Least standard deviation of a joint's torque, as a share of its rms: errors of the computation, not of readings."""


@dataclass(frozen=True)
class Dynamics:
    """Identified dynamics beside the true ones.

    ``values`` (91,) are standard parameters of possible bodies, ``truth`` (91,) those of the simulation. ``std`` (B,)
    are standard deviations of the base parameters by least squares. ``error_pct`` (7,) are the rms errors of the
    torques on the validation movements, in % of the rms torque, and ``plain_error_pct`` (7,) those of plain least
    squares. ``undetermined_pct`` (7,) is the rms torque of the base parameters that are not determined, in % too.
    ``rows`` are the numbers of rows of training and validation.
    """

    base: BaseParameters
    values: Array
    truth: Array
    std: Array
    error_pct: Array
    plain_error_pct: Array
    undetermined_pct: Array
    rows: tuple[int, int]

    @property
    def determined(self) -> NDArray[np.bool_]:
        """Mark the base parameters (B,) that the movements determine: the others have a larger deviation."""
        return np.asarray(self.std <= DETERMINED * np.abs(self.identified))

    @property
    def identified(self) -> Array:
        """Base parameters (B,) as identified."""
        return self.base.combine @ self.values

    @property
    def true(self) -> Array:
        """Base parameters (B,) of the simulation."""
        return self.base.combine @ self.truth


def identify_dynamics(spec: MujocoPlant, seed: int) -> Dynamics:
    """Move the simulated arm, and identify its base parameters from encoders and torques.

    Three movements of 20 s train and two others validate, each chosen by `excitation` from a stream of its own.
    Without noise of the encoders nothing is filtered.
    Raises `InputError` without MuJoCo, `DataError` where the solver fails. Oracle: the parameters that MuJoCo
    simulates, test_identify_dynamics.
    """
    base, arm = base_parameters(), ArmPhysics(spec)
    noise_std = np.full(N_JOINTS, spec.encoder_noise_mrad / 1000.0)
    noise_std[INSERTION] = spec.encoder_noise_mm / 1000.0
    rows_of = equations if noise_std.any() else clean_equations
    found = []
    for n in range(N_TRAINING + N_VALIDATION):
        set_points = excitation(
            Stream.named(seed, f"dynamics/{n}/movement"), base.independent, spec.physics_hz, DURATION_S
        )
        motion = arm.follow(arm.at_rest(set_points[0]), set_points)
        told = read(motion, noise_std, Stream.named(seed, f"dynamics/{n}/noise"))
        found.append(rows_of(told, spec.physics_hz, base.independent))
    training, validation = Equations.joined(found[:N_TRAINING]), Equations.joined(found[N_TRAINING:])
    return fit(training, validation, base, true_parameters(spec.friction))


def fit(training: Equations, validation: Equations, base: BaseParameters, truth: Array) -> Dynamics:
    """Identify the base parameters by the training equations, and validate them on others.

    The torques are weighted by the inverse standard deviation of each joint's residuals, from a first fit by plain
    least squares.
    """
    matrix, torque, joint = training
    rms = np.array([np.sqrt(np.mean(torque[joint == j] ** 2)) for j in range(N_JOINTS)])
    plain = _least_squares(matrix, torque, 1.0 / rms[joint])
    residual = torque - matrix @ plain
    std = np.array([residual[joint == j].std() for j in range(N_JOINTS)])
    weight = 1.0 / np.maximum(std, _FINEST * rms)[joint]
    plain = _least_squares(matrix, torque, weight)
    values = consistent_fit(matrix * weight[:, None], torque * weight, base)
    # weighted residuals have the variance 1, so the inverse of the information is the covariance
    information = (matrix * weight[:, None]).T @ (matrix * weight[:, None])
    deviation, found = np.sqrt(np.linalg.inv(information).diagonal()), base.combine @ values
    unsure = np.where(deviation <= DETERMINED * np.abs(found), 0.0, base.combine @ truth)
    return Dynamics(
        base=base,
        values=values,
        truth=truth,
        std=deviation,
        error_pct=_error_pct(validation, found),
        plain_error_pct=_error_pct(validation, plain),
        undetermined_pct=_rms_pct(validation, validation.matrix @ unsure),
        rows=(len(torque), len(validation.torque)),
    )


def _least_squares(matrix: Array, torque: Array, weight: Array) -> Array:
    weighted = matrix * weight[:, None]
    lengths = np.linalg.norm(weighted, axis=0)
    found, *_ = np.linalg.lstsq(weighted / lengths, torque * weight)
    return np.asarray(found / lengths)


def _error_pct(rows: Equations, values: Array) -> Array:
    return _rms_pct(rows, rows.torque - rows.matrix @ values)


def _rms_pct(rows: Equations, values: Array) -> Array:
    """Return the rms (7,) of ``values`` (R,) at each joint, in % of its rms torque."""
    of = [(values[rows.joint == j], rows.torque[rows.joint == j]) for j in range(N_JOINTS)]
    return np.array([100.0 * np.sqrt(np.mean(v**2) / np.mean(t**2)) for v, t in of])
