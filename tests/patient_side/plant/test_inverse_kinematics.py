import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import HIGH, LOW, tip_frame
from tis.patient_side.plant.inverse_kinematics import joints_for

HOME = np.array([0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0])
SHARES = arrays(float, 7, elements=st.floats(0.0, 1.0))


def pose(place_m: Array, vector: Array) -> Array:
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_rotvec(vector).as_matrix()
    frame[:3, 3] = place_m
    return frame


@given(SHARES)
def test_joints_come_back_from_their_pose(share: Array) -> None:
    joints = LOW + share * (HIGH - LOW)
    found = joints_for(tip_frame(joints), float(joints[6]), joints)
    assert found.joints == pytest.approx(joints, abs=1e-6)


@given(arrays(float, 3, elements=st.floats(-0.5, 0.5)), arrays(float, 3, elements=st.floats(-3.0, 3.0)), SHARES)
def test_any_pose_gives_joints_within_their_limits(place_m: Array, vector: Array, share: Array) -> None:
    near = LOW + share * (HIGH - LOW)
    target = pose(place_m, vector)
    found = joints_for(target, 0.3, near)
    assert (found.joints >= LOW).all()
    assert (found.joints <= HIGH).all()
    if not found.is_clamped:
        assert tip_frame(found.joints) == pytest.approx(target, abs=1e-9)


@given(arrays(float, 3, elements=st.floats(-0.03, 0.03)), arrays(float, 3, elements=st.floats(-3.0, 3.0)))
def test_the_place_comes_first_where_the_wrist_cannot_turn_so_far(offset_m: Array, vector: Array) -> None:
    target = pose(tip_frame(HOME)[:3, 3] + offset_m, vector)
    found = joints_for(target, 0.0, HOME)
    assert tip_frame(found.joints)[:3, 3] == pytest.approx(target[:3, 3], abs=1e-7)


def test_a_place_beyond_the_insertion_is_clamped_on_the_shaft_s_line() -> None:
    target = tip_frame(HOME)
    target[2, 3] = -0.4
    found = joints_for(target, 0.0, HOME)
    assert found.is_clamped
    assert found.joints == pytest.approx([0.0, 0.0, 0.24, 0.0, 0.0, 0.0, 0.0], abs=1e-12)


def test_the_roll_goes_on_turning_the_same_way() -> None:
    joints = HOME.copy()
    for degrees in range(0, 250, 10):
        target = tip_frame(HOME) @ pose(np.zeros(3), np.array([0.0, 0.0, np.radians(degrees)]))
        joints = joints_for(target, 0.0, joints).joints
        assert abs(np.degrees(joints[3])) == pytest.approx(degrees, abs=1e-9)


def test_a_target_in_the_remote_centre_leaves_the_arm_where_it_is() -> None:
    target = tip_frame(HOME)
    target[:3, 3] = [0.0, 0.0, -0.0193]  # the wrist's pitch axis would lie in the centre
    found = joints_for(target, 0.0, HOME)
    assert found.is_clamped
    assert found.joints.tolist() == HOME.tolist()
