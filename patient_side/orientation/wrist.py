"""Orientation and gripper of an arm as messages and records carry them."""

from math import sqrt
from typing import Final, NamedTuple

from common.channels import Hand
from common.messages import Pose, Quaternion, Vector3
from common.records import OrientationNote
from patient_side.orientation.protocol import WristEstimate
from patient_side.statespace import Array

LEVEL: Final = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)


class Wrist(NamedTuple):
    """Orientation of a tool tip, and opening angle of its gripper in rad."""

    orientation: Quaternion
    gripper_rad: float


class Stated(NamedTuple):
    """An estimate and its standard deviations in rad, those of the orientation about the axes of its frame."""

    orientation: Quaternion | None
    std_rad: Vector3 | None
    gripper_rad: float | None
    gripper_std_rad: float | None


def quaternion(orientation: Array) -> Quaternion:
    """Return an orientation (4,) as a message's quaternion."""
    x, y, z, w = orientation.tolist()
    return Quaternion(x=x, y=y, z=z, w=w)


def components(orientation: Quaternion) -> tuple[float, float, float, float]:
    """Return a message's quaternion as x, y, z, w."""
    return orientation.x, orientation.y, orientation.z, orientation.w


def stated(estimate: WristEstimate) -> Stated:
    """Return an estimate as records state it."""
    orientation, covariance, gripper_rad, variance = estimate
    std_rad = None
    if covariance is not None:
        x, y, z = covariance.diagonal().tolist()
        std_rad = Vector3(x=sqrt(x), y=sqrt(y), z=sqrt(z))
    return Stated(
        None if orientation is None else quaternion(orientation),
        std_rad,
        gripper_rad,
        None if variance is None else sqrt(variance),
    )


def answered(estimate: Stated, newest: Pose | None) -> Wrist:
    """Return what an answer carries: the estimate, the ``newest`` sample's without one, level before any sample."""
    orientation, gripper_rad = estimate.orientation, estimate.gripper_rad
    if orientation is None:
        orientation = LEVEL if newest is None else newest.orientation
    if gripper_rad is None:
        gripper_rad = 0.0 if newest is None else newest.gripper_rad
    return Wrist(orientation, gripper_rad)


def orientation_note(tick: int, t_ns: int, hand: Hand, method: str, found: Stated, step_ns: int) -> OrientationNote:
    """Return the record of one method at one tick."""
    return OrientationNote(
        tick=tick,
        t_ns=t_ns,
        hand=hand,
        method=method,
        orientation=found.orientation,
        std_rad=found.std_rad,
        gripper_rad=found.gripper_rad,
        gripper_std_rad=found.gripper_std_rad,
        step_ns=step_ns,
    )
