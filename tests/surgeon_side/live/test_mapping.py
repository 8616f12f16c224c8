from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tis.common.devices.gate import DeviceSample
from tis.common.scenario.live_source import LiveSource
from tis.surgeon_side.live.mapping import Mapping, quaternion_of, turned

PERIOD = 33_333_333
SMALL = st.floats(-0.01, 0.01)
PLACE = st.tuples(SMALL, SMALL, SMALL)
ANGLES = st.tuples(st.floats(-180, 180), st.floats(-180, 180), st.floats(-180, 180))


def a_mapping(**source: Any) -> Mapping:
    return Mapping(LiveSource(kind="live", **source), "left")


def at(place: tuple[float, float, float], clutch: bool = False, turn: Any = (0, 0, 0, 1.0)) -> DeviceSample:
    return DeviceSample(0, None, place, turn, 0.25, clutch)


def test_a_hand_rests_in_its_places_until_the_first_pose_and_begins_there() -> None:
    mapping = a_mapping()
    command, arm = mapping.poses()
    assert (command.position_m, arm.position_m) == ((0.1, -0.05, 0.35), (0.05, 0.025, 0.025))
    mapping.move([at((7.0, 8.0, 9.0))], 0, PERIOD)
    command, arm = mapping.poses()
    assert command.position_m == pytest.approx((0.1, -0.05, 0.35), abs=1e-12)
    assert arm.position_m == pytest.approx((0.05, 0.025, 0.025), abs=1e-12)
    assert arm.gripper_rad == 0.25


def test_with_origin_zero_the_devices_own_frame_counts() -> None:
    mapping = a_mapping(origin="zero", scale=0.25)
    mapping.move([at((0.004, 0.0, -0.008))], 0, PERIOD)
    command, arm = mapping.poses()
    assert command.position_m == pytest.approx((0.104, -0.05, 0.342), abs=1e-15)
    assert arm.position_m == pytest.approx((0.051, 0.025, 0.023), abs=1e-15)


@given(ANGLES, PLACE)
def test_turns_are_scipys(rotation_deg: tuple[float, float, float], place: tuple[float, float, float]) -> None:
    expected = Rotation.from_rotvec(rotation_deg, degrees=True)
    assert turned(quaternion_of(rotation_deg), place) == pytest.approx(expected.apply(place), abs=1e-14)


@given(ANGLES, st.floats(0.01, 10), st.lists(st.tuples(PLACE, st.booleans()), min_size=1, max_size=12), st.data())
def test_master_and_arm_are_where_the_formula_puts_them(
    rotation_deg: tuple[float, float, float],
    scale: float,
    path: list[tuple[tuple[float, float, float], bool]],
    data: st.DataObject,
) -> None:
    """The sum of all steps, and for the arm of those without the clutch, however they fall into ticks."""
    mapping, k, todo = a_mapping(rotation_deg=rotation_deg, scale=scale), 0, [at(*step) for step in path]
    while todo:
        n = data.draw(st.integers(1, len(todo)))
        mapping.move(todo[:n], k * PERIOD, PERIOD)
        todo, k = todo[n:], k + 1
    where = np.array([place for place, _ in path])
    clutched = np.array([clutch for _, clutch in path])
    steps = Rotation.from_rotvec(rotation_deg, degrees=True).apply(np.diff(where, axis=0, prepend=where[:1]))
    free = ~(clutched | np.roll(clutched, 1))
    free[0] = True
    command, arm = mapping.poses()
    assert command.position_m == pytest.approx(np.array([0.1, -0.05, 0.35]) + steps.sum(axis=0), abs=1e-12)
    assert arm.position_m == pytest.approx(
        np.array([0.05, 0.025, 0.025]) + scale * steps[free].sum(axis=0), abs=1e-12
    )
    assert mapping.n_jumps == 0


def test_the_arm_keeps_its_wrist_while_the_clutch_is_pressed() -> None:
    mapping = a_mapping(rotation_deg=(0, 0, 90))
    half = float(np.sqrt(0.5))
    mapping.move([at((0, 0, 0)), at((0, 0, 0), clutch=True, turn=(half, 0.0, 0.0, half))], 0, PERIOD)
    command, arm = mapping.poses()
    assert arm.orientation == pytest.approx((0, 0, half, half))
    expected = Rotation.from_euler("z", 90, degrees=True) * Rotation.from_euler("x", 90, degrees=True)
    assert Rotation.from_quat(command.orientation).approx_equal(expected, atol=1e-12)


def test_a_jump_is_not_followed_and_the_movement_goes_on_from_there() -> None:
    mapping = a_mapping(max_speed_mm_s=300)  # 20 mm over a tick and the period allowed for its jitter
    mapping.move([at((0, 0, 0))], 0, PERIOD)
    mapping.move([at((0.019, 0, 0))], PERIOD, PERIOD)
    before = mapping.poses()
    mapping.move([at((0.040, 0, 0))], 2 * PERIOD, PERIOD)
    assert mapping.n_jumps == 1
    assert mapping.poses().command.position_m == pytest.approx(before.command.position_m, abs=1e-12)
    assert mapping.poses().arm.position_m == pytest.approx(before.arm.position_m, abs=1e-12)
    mapping.move([at((0.041, 0, 0))], 3 * PERIOD, PERIOD)
    assert mapping.poses().command.position_m[0] - before.command.position_m[0] == pytest.approx(0.001)
    assert mapping.poses().arm.position_m[0] - before.arm.position_m[0] == pytest.approx(0.0005)


def test_after_a_silence_a_long_way_is_no_jump() -> None:
    mapping = a_mapping(max_speed_mm_s=300)
    mapping.move([at((0, 0, 0))], 0, PERIOD)
    mapping.move([at((0.25, 0, 0))], 30 * PERIOD, PERIOD)
    assert mapping.n_jumps == 0
