"""Regressor of the arm's inverse dynamics: torques are linear in the standard parameters."""

from typing import Final

import numpy as np

from tis.patient_side.dynamics.parameters import N_OF_LINK, N_PARAMETERS, PER_LINK
from tis.patient_side.plant.arm_geometry import GRAVITY_M_S2, INSERTION, N_JOINTS, link_transforms
from tis.patient_side.statespace import Array

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
