"""Orientation and gripper of a set point: they move by the law of its place, as angles."""

from typing import NamedTuple

from tis.patient_side.rotations import Quaternion, after_turn, is_orientation, turn_to
from tis.patient_side.safety.set_point import AT_REST, Motion, Moved, Pace, brake, follow

_LEVEL: Quaternion = (0.0, 0.0, 0.0, 1.0)


class WristPose(NamedTuple):
    """Orientation x, y, z, w of any length but 0, and the gripper's angle in rad."""

    orientation: Quaternion
    gripper_rad: float


class WristPoint(NamedTuple):
    """Wrist of the set point after a tick, what it follows, and the motions of both parts.

    ``is_slow``: it follows at the pace of resuming until it has met its target.
    """

    at: WristPose
    target: WristPose
    turning: Motion = AT_REST
    gripping: Motion = AT_REST
    is_slow: bool = False


class WristLimits(NamedTuple):
    """Bounds of a tick in rad, of turning and of the gripper alike."""

    usual: Pace
    slow: Pace
    most_corrected: float


def begin(wrist: WristPose) -> WristPoint:
    """Return the first set point: the target itself, at rest."""
    at = WristPose(wrist.orientation if is_orientation(wrist.orientation) else _LEVEL, wrist.gripper_rad)
    return WristPoint(at, at, Motion(has_met=True), Motion(has_met=True))


def follow_wrist(point: WristPoint, target: WristPose, pace: Pace, most_corrected: float, t_ns: int) -> WristPoint:
    """Return the wrist on its way to ``target``; where the bounds allow it is the target's, bit for bit.

    A target of no orientation leaves the orientation where it is. Oracle: test_wrist_point, with SciPy's rotations.
    """
    (here, gripper_rad), there = point.at, target.orientation
    if not is_orientation(there):
        there = here
    turned = follow(turn_to(here, there), point.turning, pace, most_corrected, t_ns)
    way = (target.gripper_rad - gripper_rad, 0.0, 0.0)
    opened = follow(way, point.gripping, pace, most_corrected, t_ns)
    at = WristPose(
        there if turned.meets else after_turn(here, turned.by),
        target.gripper_rad if opened.meets else gripper_rad + opened.by[0],
    )
    is_slow = point.is_slow and not (turned.meets and opened.meets)
    return WristPoint(at, WristPose(there, target.gripper_rad), turned.motion, opened.motion, is_slow)


def brake_wrist(point: WristPoint, change: float) -> WristPoint:
    """Return the wrist that gives up its target and comes to rest."""
    turned, opened = brake(point.turning, change), brake(point.gripping, change)
    at = WristPose(_moved(point.at.orientation, turned), point.at.gripper_rad + opened.by[0])
    return WristPoint(at, at, turned.motion, opened.motion, point.is_slow)


def _moved(orientation: Quaternion, turned: Moved) -> Quaternion:
    """Return the orientation after a movement; without one it stays as it is, bit for bit."""
    return after_turn(orientation, turned.by) if any(turned.by) else orientation
