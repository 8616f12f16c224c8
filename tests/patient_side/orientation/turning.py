"""Movements of a wrist for tests: constant rotation, and smooth random turning."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tis.common.sources.trajectory import Array
from tis.patient_side.playout import SourceBuffer

RATE_HZ = 30
LOST = -1


def constant_turn(n_rows: int, axis: tuple[float, float, float], deg_per_s: float, start_deg: float = 0.0) -> Array:
    """Orientations (N, 4) of a body that turns at a constant speed about a fixed axis, from a tilted start."""
    angles = np.radians(start_deg + deg_per_s * np.arange(n_rows) / RATE_HZ)
    unit = np.array(axis) / np.linalg.norm(axis)
    tilted = Rotation.from_rotvec([0.3, -0.4, 0.2])
    return np.asarray((tilted * Rotation.from_rotvec(angles[:, None] * unit)).as_quat(), dtype=np.float64)


def random_turns(rng: np.random.Generator, n_rows: int, damping: float = 0.9, noise_rad: float = 0.004) -> Array:
    """Orientations (N, 4) whose rate in the body frame is AR(1), with signs of quaternions that change at random."""
    rate, orientation, rows = np.zeros(3), Rotation.identity(), []
    for _ in range(n_rows):
        rows.append(orientation.as_quat())
        rate = damping * rate + noise_rad * rng.normal(size=3)
        orientation = orientation * Rotation.from_rotvec(rate)
    return np.asarray(np.array(rows) * rng.choice([-1.0, 1.0], size=(n_rows, 1)), dtype=np.float64)


def random_angles(rng: np.random.Generator, n_rows: int, damping: float = 0.8, noise_rad: float = 0.01) -> Array:
    """Angles (N,) whose rate is AR(1)."""
    rates = np.zeros(n_rows)
    for k in range(1, n_rows):
        rates[k] = damping * rates[k - 1] + noise_rad * rng.normal()
    return np.cumsum(rates)


def arrived(orientations: Array, grippers_rad: NDArray[Any], lost: tuple[int, ...] = ()) -> SourceBuffer:
    """The buffer after all rows but the ``lost`` ones have arrived."""
    buffer = SourceBuffer(4096)
    for k, (orientation, gripper_rad) in enumerate(zip(orientations, grippers_rad, strict=True)):
        if k not in lost:
            buffer.add(k, np.zeros(3), float(gripper_rad), orientation)
    return buffer


def angle_deg(one: Array, other: Array) -> float:
    """The angle between two orientations, by SciPy."""
    return float(np.degrees((Rotation.from_quat(one).inv() * Rotation.from_quat(other)).magnitude()))
