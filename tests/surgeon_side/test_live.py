import json
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tis.common.device import DeviceSample
from tis.common.device_records import DEVICES, TARGET_RUNS, DeviceNote, TargetRunNote
from tis.common.messages import Header, Pose, decode
from tis.common.node import Arrival, Emission, Record
from tis.common.records import TRUTH, TruthRow
from tis.common.scenario.live_source import LiveSource
from tis.common.ticker import Ticker
from tis.surgeon_side.live import DeviceMapping, LiveMotion, quaternion_of, turned
from tis.surgeon_side.node import SurgeonNode

PERIOD = 33_333_333
SMALL = st.floats(-0.01, 0.01)
PLACE = st.tuples(SMALL, SMALL, SMALL)
ANGLES = st.tuples(st.floats(-180, 180), st.floats(-180, 180), st.floats(-180, 180))


def a_mapping(**source: Any) -> DeviceMapping:
    return DeviceMapping(LiveSource(kind="live", **source), "left")


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


MS = 1_000_000
LEFT = "device/MTML/measured_cp"


def a_node(n_ticks: int = 100, **source: Any) -> SurgeonNode:
    motion = LiveMotion(LiveSource(kind="live", **source), 10)
    return SurgeonNode("tis", motion, Ticker(10, n_ticks))


def pose(ms: int, x: float, key: str = LEFT, **more: Any) -> Arrival:
    content = json.dumps({"position_m": {"x": x, "y": 0, "z": 0}} | more).encode()
    return Arrival("west", key, content, b"", ms * MS)


def sent(outputs: Any) -> dict[str, float]:
    emissions = [output for output in outputs if isinstance(output, Emission)]
    return {each.key: decode(each.payload, Pose).position_m.x for each in emissions}


def notes(outputs: Any) -> list[tuple[str, int, int, str]]:
    found = [output.data for output in outputs if isinstance(output, Record) and output.topic == DEVICES]
    return [(n.event, n.at_ns // MS, n.for_ns // MS, n.reason) for n in found if isinstance(n, DeviceNote)]


def truth(outputs: Any) -> list[tuple[int, float]]:
    found = [output.data for output in outputs if isinstance(output, Record) and output.topic == TRUTH]
    return [(row.index, row.position_m.x) for row in found if isinstance(row, TruthRow)]


def test_a_sample_is_the_newest_pose_at_its_instant_and_truth_is_the_commanded_arm() -> None:
    node = a_node()
    assert ("west", LEFT) in node.listens()
    assert sent(node.wake(0)) == {"tis/MTML/measured_cp": 0.1, "tis/PSM2/setpoint_cp": 0.05}
    for ms, x in ((20, 1.0), (60, 1.01), (100, 1.02)):
        assert node.receive(pose(ms, x)) == ()
    outputs = node.wake(100 * MS)
    assert sent(outputs)["tis/MTML/measured_cp"] == pytest.approx(0.12)
    assert sent(outputs)["tis/PSM2/setpoint_cp"] == pytest.approx(0.06)
    ((index, x),) = truth(outputs)
    assert index == 1
    assert x == pytest.approx(0.06)
    headers = [output.attachment for output in outputs if isinstance(output, Emission)]
    assert headers == [Header(1), Header(1)]
    node.receive(pose(101, 1.03))
    assert sent(node.wake(200 * MS))["tis/MTML/measured_cp"] == pytest.approx(0.13)


def test_a_missed_sample_has_no_truth() -> None:
    node = a_node()
    node.wake(0)
    outputs = node.wake(300 * MS)
    assert truth(outputs) == [(3, 0.05)]
    assert node.counters()["ticks_missed"] == 2


def test_a_device_that_stops_holds_its_last_pose_and_the_log_says_so() -> None:
    node = a_node(silent_after_ms=250)
    node.receive(pose(0, 5.0))
    seen = notes(node.wake(0))
    node.receive(pose(50, 5.02))
    for k in range(1, 8):
        outputs = node.wake(k * 100 * MS)
        seen += notes(outputs)
        assert sent(outputs)["tis/PSM2/setpoint_cp"] == pytest.approx(0.06)
    node.receive(pose(750, 5.04))
    seen += notes(node.wake(800 * MS))
    assert seen == [("first", 0, 0, ""), ("silent", 400, 350, ""), ("back", 800, 750, "")]
    counters = node.counters()
    assert counters["device_silences.left"] == 1
    assert counters["device_silent_ticks.left"] == 4  # 400 to 700 ms
    assert counters["device_poses.left"] == 3


def test_no_device_at_all_is_a_silence() -> None:
    node = a_node(silent_after_ms=150)
    seen = [note for k in range(4) for note in notes(node.wake(k * 100 * MS))]
    assert seen == [("silent", 200, 200, "")]


def test_each_kind_of_refusal_is_told_once_and_counted_always() -> None:
    node = a_node()
    seen = []
    for k in range(3):
        node.receive(Arrival("west", LEFT, b"junk", b"", k * 100 * MS))
        node.receive(pose(k * 100, 0.0, stamp_ns=5))
        seen += notes(node.wake(k * 100 * MS))
    assert [(event, reason) for event, _, _, reason in seen] == [
        ("first", ""), ("refused", "undecodable"), ("refused", "backwards"),
    ]  # fmt: skip
    assert node.counters()["device_undecodable.left"] == 3
    assert node.counters()["device_backwards.left"] == 2


def test_after_the_last_sample_a_device_that_goes_on_sends_nothing_too_fast() -> None:
    node = a_node(n_ticks=2)
    for k in range(2):
        node.receive(pose(k * 100, 0.0))
        node.wake(k * 100 * MS)
    for ms in range(101, 500):
        node.receive(pose(ms, 0.0))
    assert node.counters()["device_flooded.left"] == 0
    assert node.counters()["device_poses.left"] == 2


def test_a_jump_is_told() -> None:
    node = a_node(max_speed_mm_s=100)
    node.receive(pose(0, 0.0))
    node.wake(0)
    node.receive(pose(90, 1.0))
    outputs = node.wake(100 * MS)
    assert notes(outputs) == [("refused", 100, 0, "jump")]
    assert sent(outputs)["tis/MTML/measured_cp"] == pytest.approx(0.1)
    assert node.counters()["device_jump.left"] == 1


def test_each_hand_has_its_device_and_its_arm() -> None:
    node = a_node(hands=["left", "right"])
    for ms in (0, 50):
        node.receive(pose(ms, ms * 0.001, "device/MTMR/measured_cp"))
    found = sent(node.wake(100 * MS))
    assert found["tis/MTML/measured_cp"] == 0.1
    assert found["tis/MTMR/measured_cp"] == pytest.approx(0.25)
    assert found["tis/PSM1/setpoint_cp"] == pytest.approx(0.025)


def test_a_run_at_targets_is_logged_with_its_hand_and_a_flood_of_them_is_not() -> None:
    node, found = a_node(), []
    told: dict[str, Any] = {"delay_ms": 300, "with_ghost": False, "time_s": 9.5, "path_mm": 400.0, "n_misses": 2}
    for k in range(12):
        for ms in range(100 * k + 1, 100 * k + 100):
            node.receive(pose(ms, 0.0, target_run=told))
        outputs = node.wake((k + 1) * 100 * MS)
        found += [one.data for one in outputs if isinstance(one, Record) and one.topic == TARGET_RUNS]
    assert found[0] == TargetRunNote(at_ns=MS, hand="left", **told)
    assert len(found) == 1000
    assert node.counters()["device_poses.left"] == 12 * 99


def test_answers_of_the_patient_are_no_device() -> None:
    node = a_node()
    (record,) = node.receive(Arrival("west", "tis/PSM2/estimated_cp", b"{}", b"", 5))
    assert isinstance(record, Record)
    assert node.counters()["rejected"] == 1


@pytest.mark.parametrize("origin", ["first", "zero"])
@pytest.mark.parametrize("path", [(9e8,), (0.0, 9e8), (-9e8, 9e8), (6e8, -6e8, 6e8)])
@pytest.mark.parametrize("per_tick", [1, 3])
def test_a_device_at_the_end_of_all_places_jumps_and_the_hand_stays(
    origin: str, path: tuple[float, ...], per_tick: int
) -> None:
    node = a_node(origin=origin, scale=10, rotation_deg=(0, 0, 45))
    for k in range(0, len(path), per_tick):
        for place in path[k : k + per_tick]:
            node.receive(pose(100 * k, place))
        found = sent(node.wake(100 * k * MS))
        assert found["tis/MTML/measured_cp"] == pytest.approx(0.1, abs=1e-5)
        assert found["tis/PSM2/setpoint_cp"] == pytest.approx(0.05, abs=1e-5)
    node.receive(pose(900, path[-1] + 0.1))
    assert sent(node.wake(1000 * MS))["tis/MTML/measured_cp"] == pytest.approx(0.1 + 0.1 / 2**0.5, abs=1e-5)
