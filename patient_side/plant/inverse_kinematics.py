"""Inverse kinematics of the simulated arm in closed form; what lies outside the joints' limits is clamped.

The wrist's pitch axis is not on its yaw axis, so the wrist is not spherical. Still there is a closed form: the remote
centre, both wrist axes and the shaft lie in the plane that the yaw axis spans with the point on it (`_wrist_centre`).
"""

from math import asin, atan2, pi, sqrt
from typing import Final, NamedTuple

import numpy as np

from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import (
    HIGH,
    LOW,
    PITCH_TO_YAW_M,
    RCC_M,
    TIP,
    TOOL_M,
    YAW_TO_TIP_M,
    link_transforms,
)

_ROUNDS: Final = 12
"""Each brings the tip at least five times closer: the wrist is 20 mm long and at least 110 mm from its pivot."""
_LEAST_M: Final = 1e-6
_SAME: Final = 1e-9


class Reached(NamedTuple):
    """Positions (7,) of the joints, in rad, of the insertion in m; whether the pose lies outside their limits."""

    joints: Array
    is_clamped: bool


def joints_for(tip: Array, jaw_rad: float, near: Array) -> Reached:
    """Return the joints that bring the control point to a pose, or as near as their limits allow.

    The position comes first: where the wrist cannot take the orientation, its joints stop at their limits, and the
    shaft brings the tip to its place with the wrist as it is. A place out of reach is approached along each joint.

    Parameters
    ----------
    tip
        Pose (4, 4) of the control point in the base, a homogeneous transform.
    jaw_rad
        Opening of the jaws, in rad.
    near
        Positions (7,) of the joints before; the roll takes the turn that is nearest to them.

    Returns
    -------
    Reached
        Joints within `LOW` and `HIGH`, and whether any but the jaw was clamped.

    Notes
    -----
    Oracle: `tip_frame` of random joints and back, test_inverse_kinematics.
    """
    wrist_m, pitch_to_yaw = _wrist_centre(tip)
    distance_m = sqrt(float(wrist_m @ wrist_m))
    if distance_m < _LEAST_M:  # within the pivot the shaft has no direction
        return Reached(near.copy(), True)
    arm = _shaft_joints(wrist_m, distance_m)
    wanted = np.array([*arm, *_wrist_joints(arm, tip, pitch_to_yaw), jaw_rad])
    wanted[3] = _nearest_turn(float(wanted[3]), float(near[3]))
    joints = np.clip(wanted, LOW, HIGH)
    off = np.abs(joints - wanted)[:-1]  # without the jaw, which has nothing to do with the pose
    if off[3:].max() > _SAME:
        joints[:3] = _place_with_wrist(tip[:3, 3], joints)
    return Reached(joints, bool(off.max() > _SAME))


def _wrist_centre(tip: Array) -> tuple[Array, Array]:
    """Return the point (3,) where pitch axis and shaft meet, and the unit vector from there to the yaw axis."""
    yaw_axis = -tip[:3, 0]
    at_yaw_m = tip[:3, 3] - YAW_TO_TIP_M * tip[:3, 2]
    across = at_yaw_m - (at_yaw_m @ yaw_axis) * yaw_axis
    length_m = sqrt(float(across @ across))
    # The shaft lies along the yaw axis: the wrist would be bent by 90 degrees, and any direction serves.
    towards = across / length_m if length_m > _LEAST_M else tip[:3, 2]
    return at_yaw_m - PITCH_TO_YAW_M * towards, towards


def _shaft_joints(wrist_m: Array, distance_m: float) -> tuple[float, float, float]:
    """Return outer yaw, outer pitch and insertion that bring the wrist to a point (3,) at this distance."""
    x, y, z = (wrist_m / distance_m).tolist()
    return atan2(x, -z), asin(max(-1.0, min(1.0, -y))), distance_m + RCC_M - TOOL_M


def _wrist_joints(arm: tuple[float, float, float], tip: Array, pitch_to_yaw: Array) -> tuple[float, float, float]:
    """Return roll, wrist pitch and wrist yaw for a pose (4, 4) of the control point."""
    moves = link_transforms(np.array([*arm, 0.0, 0.0, 0.0, 0.0]))
    shaft = moves[0, :3, :3] @ moves[1, :3, :3] @ moves[2, :3, :3]
    yaw_axis = -tip[:3, 0]
    pitch_axis = np.cross(pitch_to_yaw, yaw_axis)
    x, y, _ = (shaft.T @ pitch_axis).tolist()
    roll_rad = atan2(-x, y)
    across = np.cross(pitch_axis, shaft[:, 2])
    pitch_rad = atan2(float(pitch_to_yaw @ across), float(pitch_to_yaw @ shaft[:, 2]))
    yaw_rad = atan2(-float(tip[:3, 2] @ pitch_axis), float(tip[:3, 2] @ pitch_to_yaw))
    return roll_rad, pitch_rad, yaw_rad


def _nearest_turn(roll_rad: float, near_rad: float) -> float:
    """Return the roll plus the whole turns that bring it nearest to ``near_rad``, within the limits if possible."""
    turns = [roll_rad + 2.0 * pi * n for n in (-1, 0, 1)]
    allowed = [turn for turn in turns if LOW[3] - _SAME <= turn <= HIGH[3] + _SAME] or turns
    return min(allowed, key=lambda turn: abs(turn - near_rad))


def _place_with_wrist(place_m: Array, joints: Array) -> Array:
    """Return yaw, pitch and insertion (3,) that bring the tip to a place (3,) with the wrist's joints as they are."""
    found = joints.copy()
    for _ in range(_ROUNDS):
        moves = link_transforms(found)
        shaft = moves[0] @ moves[1] @ moves[2]
        beyond = moves[4] @ moves[5] @ TIP
        # from the wrist's centre to the tip, with the shaft's direction of the round before
        offset_m = shaft[:3, :3] @ moves[3, :3, :3] @ beyond[:3, 3]
        wrist_m = place_m - offset_m
        distance_m = max(sqrt(float(wrist_m @ wrist_m)), _LEAST_M)
        found[:3] = np.clip(_shaft_joints(wrist_m, distance_m), LOW[:3], HIGH[:3])
    return found[:3]
