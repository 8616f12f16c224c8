"""Operations on unit quaternions (x, y, z, w) for the ticks: a SciPy `Rotation` costs more than a whole estimate.

q and -q are one orientation: rotations between two orientations are the shorter ones. Oracle of all: SciPy.
"""

from collections.abc import Sequence
from math import atan2, copysign, cos, inf, sin, sqrt
from typing import Final

import numpy as np

from tis.patient_side.model_fields import Floats

Turn = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

_MIN_NORM: Final = 1e-6
_SMALL: Final = 1e-7
"""Half angle in rad below which a sine equals its angle to double precision."""
_PLACE: Final = np.array([[3, 2, 1, 0], [2, 3, 0, 1], [1, 0, 3, 2], [0, 1, 2, 3]])
_SIGN: Final = np.array(
    [[1.0, 1.0, -1.0, -1.0], [-1.0, 1.0, 1.0, -1.0], [1.0, -1.0, 1.0, -1.0], [1.0, 1.0, 1.0, 1.0]]
)
"""Conjugate of a quaternion q times p: the matrix ``q[_PLACE] * _SIGN`` times p."""


def unit(quaternion: Quaternion) -> Quaternion | None:
    """Return the unit quaternion of the same orientation; None without one: its norm is 0 or not finite."""
    x, y, z, w = quaternion
    norm = sqrt(x * x + y * y + z * z + w * w)
    return (x / norm, y / norm, z / norm, w / norm) if _MIN_NORM < norm < inf else None


def turned(now: Floats, other: Floats) -> Floats:
    """Return the rotation vectors (..., 3), in rad, that turn ``now`` (..., 4) into ``other`` (..., 4).

    ``log(R_now^-1 R_other)``: in the body frame of ``now``, of length 0 to pi. The shapes are broadcast.
    """
    if now.ndim == 1:  # as at each tick: on so few numbers Python is faster than numpy
        here = now.tolist()
        turns = [_turn_in_body(here, there) for there in other.reshape(-1, 4).tolist()]
        return np.array(turns).reshape(*other.shape[:-1], 3)
    # The conjugate of now times other, as a matrix times a vector: scalar part last.
    between = np.einsum("...ij,...j->...i", now[..., _PLACE] * _SIGN, other)
    vector, w = between[..., :3], between[..., 3]
    # The sine of half the angle, floored where it equals the half angle to double precision.
    sine = np.maximum(np.sqrt(np.vecdot(vector, vector)), _SMALL)
    factor = np.copysign(2.0 * np.arctan2(sine, np.abs(w)) / sine, w)
    return np.asarray(vector * factor[..., None])


def _turn_in_body(here: Sequence[float], there: Sequence[float]) -> Turn:
    """Return the rotation vector of `turned` for one pair."""
    (a, b, c, d), (x, y, z, w) = here, there
    e, f, g = d * x + c * y - b * z - a * w, d * y + a * z - c * x - b * w, d * z + b * x - a * y - c * w
    scalar = d * w + a * x + b * y + c * z
    sine = max(sqrt(e * e + f * f + g * g), _SMALL)
    scale = copysign(2.0 * atan2(sine, abs(scalar)) / sine, scalar)
    return scale * e, scale * f, scale * g


def turned_by(quaternion: Floats, vector: Floats) -> Floats:
    """Return the orientation (4,) after the rotation ``vector`` (3,), in rad, in the body frame: ``R exp(v)``."""
    return np.array(_product(tuple(quaternion.tolist()), _of_turn(tuple(vector.tolist()))))


def at_end(vector: Floats, covariance: Floats) -> Floats:
    """Return a covariance (3, 3) of rotation vectors about ``vector`` (3,), in the body frame at its end, in rad^2.

    ``exp(v)^-1 exp(v + e) = exp(J e)`` to first order, with the right Jacobian J of SO(3): Chirikjian, *Stochastic
    Models, Information Theory, and Lie Groups* 2 (2012), 10.86. Oracle: differences of SciPy's rotations.
    """
    a, b, c = vector.tolist()
    square = a * a + b * b + c * c
    angle = sqrt(square)
    if angle < 1e-4:  # to fourth order
        first, second = 0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0
    else:
        first, second = (1.0 - cos(angle)) / square, (angle - sin(angle)) / (angle * square)
    # I - first [v] + second [v]^2, as [v]^2 = v v^T - |v|^2 I.
    on, x, y, z = 1.0 - second * square, first * a, first * b, first * c
    ab, ac, bc = second * a * b, second * a * c, second * b * c
    jacobian = np.array(
        (
            (on + second * a * a, ab + z, ac - y),
            (ab - z, on + second * b * b, bc + x),
            (ac + y, bc - x, on + second * c * c),
        )
    )
    return np.asarray(jacobian.dot(covariance).dot(jacobian.T))


def is_orientation(quaternion: Quaternion) -> bool:
    """Tell whether numbers x, y, z, w of any length are an orientation: `unit` has one for them."""
    x, y, z, w = quaternion
    return _MIN_NORM < sqrt(x * x + y * y + z * z + w * w) < inf


def turn_to(here: Quaternion, there: Quaternion) -> Turn:
    """Return the rotation vector, in rad, in the frame of the base, that turns ``here`` into ``there``.

    ``log(R_there R_here^-1)``, of length 0 to pi; the quaternions may have any length but 0. Oracle: SciPy.
    """
    if here == there:
        return 0.0, 0.0, 0.0
    (a, b, c, d), (x, y, z, w) = here, there
    e, f, g = x * d - w * a - y * c + z * b, y * d - w * b - z * a + x * c, z * d - w * c - x * b + y * a
    scalar = w * d + x * a + y * b + z * c
    sine = sqrt(e * e + f * f + g * g)
    if sine == 0.0:
        return 0.0, 0.0, 0.0
    scale = copysign(2.0 * atan2(sine, abs(scalar)) / sine, scalar)
    return scale * e, scale * f, scale * g


def after_turn(here: Quaternion, turn: Turn) -> Quaternion:
    """Return the unit quaternion after a rotation vector in the frame of the base: ``exp(turn) R_here``."""
    return _product(_of_turn(turn), here)


def _of_turn(turn: Turn) -> Quaternion:
    """Return a rotation vector in rad as a quaternion."""
    a, b, c = turn
    half = 0.5 * sqrt(a * a + b * b + c * c)
    share = 0.5 if half < _SMALL else 0.5 * sin(half) / half
    return share * a, share * b, share * c, cos(half)


def _product(one: Quaternion, other: Quaternion) -> Quaternion:
    """Return the rotation ``other`` followed by ``one``, scaled to length 1 over any number of turns."""
    (x, y, z, w), (a, b, c, d) = one, other
    e, f, g, h = (
        w * a + x * d + y * c - z * b,
        w * b + y * d + z * a - x * c,
        w * c + z * d + x * b - y * a,
        w * d - x * a - y * b - z * c,
    )
    norm = sqrt(e * e + f * f + g * g + h * h)
    return e / norm, f / norm, g / norm, h / norm
