"""Place of the scenario's positions in the workspace of the simulated arm."""

from typing import NamedTuple, Self

import numpy as np
from scipy.spatial.transform import Rotation

from patient_side.plant.protocol import Reference
from patient_side.statespace import Array


class Registration(NamedTuple):
    """A rigid motion (4, 4) from the scenario's frame to the arm's base, and back.

    The first set point is mapped to the arm's home pose: the arm stands where its tip hangs straight below the remote
    centre, with a straight wrist, when the run begins. Distances, angles and speeds stay as they are.
    """

    to_base: Array
    from_base: Array

    @classmethod
    def at_home(cls, first: Reference, home: Array) -> Self:
        """Return the motion that brings the first set point, with its orientation, to the home pose (4, 4)."""
        to_base = home @ inverse(pose(first))
        return cls(to_base, inverse(to_base))


def pose(reference: Reference) -> Array:
    """Return a set point as a homogeneous transform (4, 4); its orientation must be known."""
    assert reference.orientation is not None
    found = np.eye(4)
    found[:3, :3] = Rotation.from_quat(reference.orientation).as_matrix()
    found[:3, 3] = reference.position_m
    return found


def orientation_of(frame: Array) -> Array:
    """Return the orientation of a homogeneous transform (4, 4) as a unit quaternion (4,) x, y, z, w."""
    return np.asarray(Rotation.from_matrix(frame[:3, :3]).as_quat())


def inverse(motion: Array) -> Array:
    """Return the inverse of a rigid motion (4, 4). Oracle: NumPy's inverse."""
    found = np.eye(4)
    found[:3, :3] = motion[:3, :3].T
    found[:3, 3] = -motion[:3, :3].T @ motion[:3, 3]
    return found
