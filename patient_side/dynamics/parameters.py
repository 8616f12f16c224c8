"""Standard parameters of the arm's dynamics: of each link ten, of each joint three.

They stand link by link in one vector (91,): mass, first moments, moments of inertia about the origin of the link's
frame, then motor inertia, viscous and Coulomb friction of the link's joint.

Regressor of the arm's inverse dynamics: torques are linear in the standard parameters.

Base parameters: the combinations of standard parameters that movements and torques determine.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import Stream
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import (
    COM_M,
    COULOMB,
    GRAVITY_M_S2,
    HIGH,
    INERTIA_KG_M2,
    INSERTION,
    LOW,
    MASS_KG,
    MOTOR_INERTIA,
    N_JOINTS,
    VISCOUS,
    link_transforms,
)

OF_LINK: Final = ("m", "mx", "my", "mz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
OF_JOINT: Final = ("motor", "viscous", "coulomb")
N_OF_LINK: Final = len(OF_LINK)
PER_LINK: Final = N_OF_LINK + len(OF_JOINT)
N_PARAMETERS: Final = N_JOINTS * PER_LINK
NAMES: Final = tuple(f"{name}_{i + 1}" for i in range(N_JOINTS) for name in (*OF_LINK, *OF_JOINT))


def links(values: Array) -> Array:
    """Return the links' parameters (7, 10) of a vector (91,)."""
    return values.reshape(N_JOINTS, PER_LINK)[:, :N_OF_LINK]


def joints(values: Array) -> Array:
    """Return motor inertia, viscous and Coulomb friction (7, 3) of a vector (91,)."""
    return values.reshape(N_JOINTS, PER_LINK)[:, N_OF_LINK:]


def true_parameters(friction: float) -> Array:
    """Return the parameters (91,) that MuJoCo simulates; ``friction`` is the scenario's multiple.

    Moments of inertia are moved to the frame's origin by Steiner's theorem. Oracle: MuJoCo's inverse dynamics,
    test_regressor.
    """
    found = np.empty((N_JOINTS, PER_LINK))
    for i in range(N_JOINTS):
        m, c = MASS_KG[i], COM_M[i]
        about_origin = np.diag(INERTIA_KG_M2[i]) + m * (c @ c * np.eye(3) - np.outer(c, c))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = about_origin
        found[i, :N_OF_LINK] = [m, *(m * c), xx, yy, zz, xy, xz, yz]
        found[i, N_OF_LINK:] = [MOTOR_INERTIA[i], friction * VISCOUS[i], friction * COULOMB[i]]
    return found.ravel()


def pseudo_inertia(link: Array) -> Array:
    """Return the pseudo-inertia (4, 4) of a link's parameters (10,): a body of positive mass density has it positive.

    Wensing, Kim and Slotine, "Linear matrix inequalities for physically consistent inertial parameter
    identification", RA-L 3(1), 2018, equation 6. Oracle: sums over point masses, test_parameters.
    """
    m, mx, my, mz, xx, yy, zz, xy, xz, yz = link
    second = np.array(
        [[(yy + zz - xx) / 2, -xy, -xz], [-xy, (xx + zz - yy) / 2, -yz], [-xz, -yz, (xx + yy - zz) / 2]]
    )
    first = np.array([[mx], [my], [mz]])
    return np.block([[second, first], [first.T, np.array([[m]])]])


_AXIS: Final = np.array([0.0, 0.0, 1.0])
_CROSS: Final = np.zeros((3, 3, 3))
_CROSS[[2, 0, 1], [1, 2, 0], [0, 1, 2]] = 1.0
_CROSS[[1, 2, 0], [2, 0, 1], [0, 1, 2]] = -1.0


def regressor(joints: Array, velocity: Array, acceleration: Array, direction: Array | None = None) -> Array:
    """Return the matrix that gives the torques from the standard parameters.

    Parameters
    ----------
    joints, velocity, acceleration
        Positions (N, 7) of the joints and their derivatives, in rad, rad/s, rad/s^2, of the insertion in m.
    direction
        What Coulomb friction is multiplied by (N, 7); not given: the sign of the velocity.

    Returns
    -------
    Array
        Matrices (N, 7, 91) Y with ``torque = Y p`` for the parameters p of `tis.patient_side.dynamics.parameters`.

    Notes
    -----
    Recursive Newton-Euler equations in the frames of the links (Luh, Walker and Paul, 1980), applied to each
    parameter: outward velocities and accelerations, inward forces and moments. Oracle: MuJoCo's inverse dynamics,
    test_regressor.
    """
    n = len(joints)
    moves = link_transforms(joints)
    spin, spin_rate, rate = (np.zeros((n, 3)) for _ in range(3))
    rate = rate - GRAVITY_M_S2  # an arm in free fall would feel no weight
    wrenches = []
    for i in range(N_JOINTS):
        turn, offset_m = moves[:, i, :3, :3], moves[:, i, :3, 3]
        v, a = velocity[:, i : i + 1] * _AXIS, acceleration[:, i : i + 1] * _AXIS
        at_origin = rate + np.cross(spin_rate, offset_m) + np.cross(spin, np.cross(spin, offset_m))
        spin, spin_rate, rate = (_into(turn, vector) for vector in (spin, spin_rate, at_origin))
        if i == INSERTION:
            rate = rate + 2.0 * np.cross(spin, v) + a
        else:
            spin_rate = spin_rate + np.cross(spin, v) + a
            spin = spin + v
        wrenches.append(_of_body(spin, spin_rate, rate))
    return _torques(moves, wrenches, (acceleration, velocity, np.sign(velocity) if direction is None else direction))


def _torques(moves: Array, wrenches: list[Array], own: tuple[Array, Array, Array]) -> Array:
    """Return what each joint feels of the links beyond it, and of its own motor and friction, (N, 7, 91)."""
    n = len(moves)
    found = np.zeros((n, N_JOINTS, N_PARAMETERS))
    carried = np.zeros((n, 6, N_PARAMETERS))  # force and moment at the frame of link i
    for i in reversed(range(N_JOINTS)):
        first = i * PER_LINK
        carried[:, :, first : first + N_OF_LINK] = wrenches[i]
        found[:, i] = carried[:, 2 if i == INSERTION else 5]
        for k, factor in enumerate(own):
            found[:, i, first + N_OF_LINK + k] = factor[:, i]
        turn, offset_m = moves[:, i, :3, :3], moves[:, i, :3, 3]
        force = turn @ carried[:, :3]
        moment = turn @ carried[:, 3:] + _cross_matrix(offset_m) @ force
        carried = np.concatenate([force, moment], axis=1)
    return found


def _of_body(spin: Array, spin_rate: Array, rate: Array) -> Array:
    """Return force and moment (N, 6, 10) at a link's origin, for each of its parameters."""
    found = np.zeros((len(spin), 6, N_OF_LINK))
    swing = _cross_matrix(spin)
    found[:, :3, 0] = rate
    found[:, :3, 1:4] = _cross_matrix(spin_rate) + swing @ swing
    found[:, 3:, 1:4] = -_cross_matrix(rate)
    found[:, 3:, 4:] = _times_inertia(spin_rate) + swing @ _times_inertia(spin)
    return found


def _times_inertia(vector: Array) -> Array:
    """Return the matrices (N, 3, 6) that give ``I v`` from Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""
    x, y, z = vector.T
    found = np.zeros((len(vector), 3, 6))
    found[:, 0, 0], found[:, 0, 3], found[:, 0, 4] = x, y, z
    found[:, 1, 1], found[:, 1, 3], found[:, 1, 5] = y, x, z
    found[:, 2, 2], found[:, 2, 4], found[:, 2, 5] = z, x, y
    return found


def _into(turn: Array, vector: Array) -> Array:
    """Return vectors (N, 3) in the next frame."""
    return np.asarray(np.einsum("nji,nj->ni", turn, vector))


def _cross_matrix(vector: Array) -> Array:
    """Return the matrices (N, 3, 3) of ``v x``."""
    return np.asarray(np.einsum("ijk,nk->nij", _CROSS, vector))


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
