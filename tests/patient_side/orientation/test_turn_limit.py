import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from common.messages import Quaternion
from patient_side.orientation.turn_limit import turn_towards
from patient_side.orientation.wrist import LEVEL, Wrist, components

ANGLE = st.floats(-3.1, 3.1)
VECTOR = st.tuples(ANGLE, ANGLE, ANGLE)


def wrist(rotation: Rotation, gripper_rad: float) -> Wrist:
    x, y, z, w = rotation.as_quat().tolist()
    return Wrist(Quaternion(x=x, y=y, z=z, w=w), gripper_rad)


@given(VECTOR, VECTOR, ANGLE, ANGLE, st.floats(0.01, 1.0))
def test_each_step_is_bounded_and_the_target_is_met_in_the_fewest_steps(
    begin: tuple[float, float, float], end: tuple[float, float, float], shut: float, opened: float, most_rad: float
) -> None:
    one, other = Rotation.from_rotvec(begin), Rotation.from_rotvec(end)
    here, target = wrist(one, shut), wrist(other, opened)
    away = float((one.inv() * other).magnitude())
    steps = int(np.ceil(max(away, abs(opened - shut)) / most_rad - 1e-6))
    for _ in range(max(steps, 1)):
        there = turn_towards(here, target, most_rad)
        moved = Rotation.from_quat(components(here.orientation)).inv() * Rotation.from_quat(
            components(there.orientation)
        )
        assert moved.magnitude() <= most_rad + 1e-6
        assert abs(there.gripper_rad - here.gripper_rad) <= most_rad + 1e-9
        here = there
    assert (Rotation.from_quat(components(here.orientation)).inv() * other).magnitude() < 1e-5
    assert here.gripper_rad == pytest.approx(opened, abs=1e-9)


def test_what_is_near_enough_is_the_target_itself() -> None:
    target = Wrist(Quaternion(x=0.0, y=0.0, z=-0.01, w=-0.99995), 0.2)
    assert turn_towards(Wrist(LEVEL, 0.1), target, 0.2) == target
