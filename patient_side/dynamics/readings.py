"""Encoders' and motors' account of a movement, and the equations of its parameters."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt
from scipy.special import ndtri

from tis.common.streams import Stream
from tis.patient_side.dynamics.excitation import MAX_SPEED
from tis.patient_side.dynamics.parameters import NAMES, regressor
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.physics import Motion

CUTOFF_HZ: Final = 45.0
"""Of the readings: thirty times the highest frequency of the movements."""
ROWS_HZ: Final = 125
"""Rate of the equations before they are filtered."""
SMOOTH_HZ: Final = 10.0
"""Of the equations: rows at twice that rate have errors that are nearly independent."""
_ORDER: Final = 4
_EDGE_S: Final = 1.0
"""Time at both ends that is left out: the arm gets up to speed, and the filters settle."""
_MOVING: Final = 0.05
"""Share of a joint's largest speed below which its rows are left out: there friction is not Coulomb's."""


class Equations(NamedTuple):
    """Rows (R, B) of the regressor, torques (R,), and the joint (R,) of each."""

    matrix: Array
    torque: Array
    joint: NDArray[np.int64]

    @classmethod
    def joined(cls, sets: "list[Equations]") -> "Equations":
        """Return all rows together."""
        return cls(*(np.concatenate(parts) for parts in zip(*sets, strict=True)))


def read(motion: Motion, noise_std: Array, noise: Stream) -> Motion:
    """Return a motion as its encoders tell it, with noise of ``noise_std`` (7,).

    The noise of joint j at step n is element ``7 n + j`` of the stream. Oracle: its distribution, test_readings.
    """
    if not noise_std.any():
        return motion
    errors = noise_std * ndtri(noise.uniforms(0, motion.joints.size)).reshape(motion.joints.shape)
    return motion._replace(joints=motion.joints + errors)


def clean_equations(motion: Motion, rate_hz: int, columns: NDArray[np.int64]) -> Equations:
    """Return the equations ``Y b = torque`` of a movement read without noise, at every step of its simulation.

    Nothing is filtered: the simulation's steps are semi-implicit, so differences of positions are the velocities that
    it used, those at a step's end for friction, at its beginning for the rest. The rows of `equations` are kept.
    Oracle: MuJoCo's torques and the true parameters, test_readings.
    """
    velocity = np.diff(motion.joints, axis=0) * rate_hz
    acceleration = np.diff(velocity, axis=0) * rate_hz
    edge = int(_EDGE_S * rate_hz)
    kept = slice(edge, len(acceleration) - edge, max(round(rate_hz / (2.0 * SMOOTH_HZ)), 1))
    joints, torque = motion.joints[1:-1][kept], motion.torque[1:-1][kept]
    before, after = velocity[:-1][kept], velocity[1:][kept]
    matrix = regressor(joints, before, acceleration[kept], np.sign(after))
    of_friction = [i for i, name in enumerate(NAMES) if name.startswith("viscous")]
    matrix[:, :, of_friction] = regressor(joints, after, acceleration[kept])[:, :, of_friction]
    return _moving_rows(matrix[:, :, columns], torque, after)


def equations(motion: Motion, rate_hz: int, columns: NDArray[np.int64]) -> Equations:
    """Return the equations ``Y b = torque`` of a movement read at ``rate_hz``, for columns (B,) of the regressor.

    Only positions and torques are used. Both pass a low-pass filter without phase (Butterworth, forward and
    backward), central differences give velocities and accelerations, and the velocity's sign, which jumps, is
    filtered likewise. Then both sides of the equations pass a narrower filter, which changes nothing in what is
    linear, and one row in 50 ms is kept: parallel filtering, Gautier, "Dynamic identification of robots with power
    model", ICRA 1997.
    Oracle: torques computed from sines and known parameters, test_readings.
    """
    smooth = butter(_ORDER, CUTOFF_HZ, fs=rate_hz, output="sos")
    joints, torque = (sosfiltfilt(smooth, values, axis=0) for values in (motion.joints, motion.torque))
    velocity = np.gradient(joints, 1.0 / rate_hz, axis=0)
    acceleration = np.gradient(velocity, 1.0 / rate_hz, axis=0)
    direction = sosfiltfilt(smooth, np.sign(velocity), axis=0)
    few = slice(None, None, max(rate_hz // ROWS_HZ, 1))
    joints, velocity, acceleration = joints[few], velocity[few], acceleration[few]
    matrix = regressor(joints, velocity, acceleration, direction[few])[:, :, columns]
    rows_hz = rate_hz / few.step
    narrow = butter(_ORDER, SMOOTH_HZ, fs=rows_hz, output="sos")
    matrix, torque = (sosfiltfilt(narrow, values, axis=0) for values in (matrix, torque[few]))
    edge = int(_EDGE_S * rows_hz)
    kept = slice(edge, len(joints) - edge, round(rows_hz / (2.0 * SMOOTH_HZ)))
    return _moving_rows(matrix[kept], torque[kept], velocity[kept])


def _moving_rows(matrix: Array, torque: Array, velocity: Array) -> Equations:
    """Return the rows of the joints that move, from (N, 7, B), (N, 7) and (N, 7)."""
    row, joint = np.nonzero(np.abs(velocity) > _MOVING * MAX_SPEED)
    return Equations(matrix[row, joint], torque[row, joint], joint.astype(np.int64))
