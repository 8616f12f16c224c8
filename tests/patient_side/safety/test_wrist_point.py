"""Orientation and gripper of a set point, against SciPy's rotations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tis.patient_side.rotations import after_turn, turn_to
from tis.patient_side.safety.set_point import (
    NO_CORRECTION,
    Motion,
    Pace,
    WristPoint,
    WristPose,
    begin,
    brake_wrist,
    follow_wrist,
)

ANGLE = st.floats(-3.1, 3.1)
VECTOR = st.tuples(ANGLE, ANGLE, ANGLE)
LEVEL = (0.0, 0.0, 0.0, 1.0)


def wrist(rotation: Rotation, gripper_rad: float) -> WristPose:
    x, y, z, w = rotation.as_quat().tolist()
    return WristPose((x, y, z, w), gripper_rad)


@given(VECTOR, VECTOR, st.floats(0.1, 10.0))
def test_turns_in_the_frame_of_the_base_are_those_of_scipy(
    one: tuple[float, float, float], two: tuple[float, float, float], length: float
) -> None:
    here, there = Rotation.from_rotvec(one), Rotation.from_rotvec(two)
    (x, y, z, w), other = here.as_quat().tolist(), there.as_quat().tolist()
    turn = turn_to((length * x, length * y, length * z, length * w), (other[0], other[1], other[2], other[3]))
    between = there * here.inv()
    assert np.linalg.norm(turn) == pytest.approx(between.magnitude(), abs=1e-6)
    assert (Rotation.from_rotvec(turn) * between.inv()).magnitude() < 1e-6
    moved = Rotation.from_quat(after_turn((x, y, z, w), two))
    assert (moved * (Rotation.from_rotvec(two) * here).inv()).magnitude() < 1e-6


@given(VECTOR, VECTOR, ANGLE, ANGLE, st.floats(0.01, 1.0))
def test_each_step_is_bounded_and_the_target_is_met_in_the_fewest_steps(
    start: tuple[float, float, float], end: tuple[float, float, float], shut: float, opened: float, most_rad: float
) -> None:
    one, other = Rotation.from_rotvec(start), Rotation.from_rotvec(end)
    point, target = begin(wrist(one, shut)), wrist(other, opened)
    away = float((one.inv() * other).magnitude())
    steps = int(np.ceil(max(away, abs(opened - shut)) / most_rad - 1e-6))
    pace = Pace(most_rad, 10.0, 10.0)  # any change of the speed
    for _ in range(max(steps, 1)):
        before, point = point.at, follow_wrist(point, target, pace, NO_CORRECTION, 0)
        moved = Rotation.from_quat(before.orientation).inv() * Rotation.from_quat(point.at.orientation)
        assert moved.magnitude() <= most_rad + 1e-6
        assert abs(point.at.gripper_rad - before.gripper_rad) <= most_rad + 1e-9
    assert (Rotation.from_quat(point.at.orientation).inv() * other).magnitude() < 1e-5
    assert point.at.gripper_rad == pytest.approx(opened, abs=1e-9)


def test_what_is_near_enough_is_the_target_itself() -> None:
    target = WristPose((0.0, 0.0, -0.01, -0.99995), 0.2)
    point = follow_wrist(begin(WristPose(LEVEL, 0.1)), target, Pace(0.2, 0.2, 0.2), NO_CORRECTION, 0)
    assert point.at == target


def test_a_target_of_no_orientation_leaves_it_where_it_is() -> None:
    nothing = WristPose((0.0, 0.0, 0.0, 0.0), 0.3)
    assert begin(nothing).at == WristPose(LEVEL, 0.3)
    here = begin(WristPose((0.0, 0.0, 0.6, 0.8), 0.1))
    point = follow_wrist(here, nothing, Pace(1.0, 1.0, 1.0), NO_CORRECTION, 0)
    assert point.at == WristPose((0.0, 0.0, 0.6, 0.8), 0.3)


def test_a_wrist_that_is_stopped_turns_on_by_the_way_of_its_speed_only() -> None:
    """It turns by 0.03 rad a tick about z, and brakes by 0.01: by 0.02 and 0.01 rad more."""
    turning = Motion((0.0, 0.0, 0.03), has_met=True)
    point = WristPoint(WristPose(LEVEL, 0.5), WristPose(LEVEL, 0.5), turning, Motion((-0.025, 0.0, 0.0)))
    angles, grippers = [], []
    for _ in range(5):
        point = brake_wrist(point, 0.01)
        angles.append(float(Rotation.from_quat(point.at.orientation).as_rotvec()[2]))
        grippers.append(point.at.gripper_rad)
    assert angles == pytest.approx([0.02, 0.03, 0.03, 0.03, 0.03])
    assert grippers == pytest.approx([0.485, 0.48, 0.48, 0.48, 0.48])
