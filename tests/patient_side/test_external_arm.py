import json
from typing import Any

import pytest

from tests.patient_side.arm_models import static_model
from tis.common.device_records import DeviceNote
from tis.common.errors import InputError
from tis.common.messages import FeedbackPose, Vector3, Wrench, decode
from tis.common.node import Arrival, Emission, Record
from tis.common.records import PLANT, PlantNote
from tis.common.runtime.recordings import load_movement
from tis.deploy.run.resolve import resolve
from tis.patient_side.build import build_patient
from tis.patient_side.external_arm import ExternalArm

MS = 1_000_000
KEY = "tis/PSM2/arm/measured_cp"


def an_arm(silent_ms: int = 250) -> ExternalArm:
    return ExternalArm("left", "PSM2", silent_ms * MS)


def pose(ms: int, x: float, **more: Any) -> Arrival:
    content = json.dumps({"position_m": {"x": x, "y": 0, "z": 0}} | more).encode()
    return Arrival("east", KEY, content, b"", ms * MS)


def notes(arm: ExternalArm) -> list[tuple[str, int, int, str]]:
    found = [record.data for record in arm.notes()]
    return [(n.event, n.at_ns // MS, n.for_ns // MS, n.reason) for n in found if isinstance(n, DeviceNote)]


def test_the_newest_pose_at_the_tick_is_the_arms_and_has_an_age() -> None:
    arm = an_arm()
    assert arm.step(None, None, 0, 0) == (None, None)
    assert arm.age_ns(0) is None
    half = {"x": 0, "y": 0, "z": 1, "w": 1}
    for ms, x in ((10, 0.1), (30, 0.2)):
        arm.take(pose(ms, x, orientation=half, gripper_rad=0.4))
    _, moved = arm.step(None, None, 1, 33 * MS)
    assert moved is not None
    assert moved.position_m.tolist() == moved.measured_m.tolist() == [0.2, 0.0, 0.0]
    assert moved.orientation is not None
    assert [round(value, 6) for value in moved.orientation.tolist()] == [0.0, 0.0, 0.707107, 0.707107]
    assert moved.gripper_rad == 0.4
    assert arm.age_ns(33 * MS) == 3 * MS
    _, moved = arm.step(None, None, 2, 66 * MS)
    assert moved is not None
    assert moved.position_m[0] == 0.2
    assert arm.age_ns(66 * MS) == 36 * MS


def test_a_robot_that_stops_is_told_and_counted() -> None:
    arm = an_arm()
    arm.take(pose(0, 0.1))
    for k in range(6):
        arm.step(None, None, k, k * 100 * MS)
    arm.take(pose(590, 0.2))
    arm.step(None, None, 6, 600 * MS)
    assert notes(arm) == [("first", 0, 0, ""), ("silent", 300, 300, ""), ("back", 600, 600, "")]
    assert notes(arm) == []
    assert arm.counters()["arm_silences.left"] == 1
    assert arm.counters()["arm_silent_ticks.left"] == 3


def test_junk_is_counted_and_moves_nothing() -> None:
    arm = an_arm()
    arm.take(pose(1, 0.1, stamp_ns=9))
    for content in (b"", b"\x00" * 5000, b'{"position_m": {"x": NaN, "y": 0, "z": 0}}'):
        arm.take(Arrival("east", KEY, content, b"", 2 * MS))
    arm.take(pose(3, 0.3, stamp_ns=8))
    _, moved = arm.step(None, None, 0, 33 * MS)
    assert moved is not None
    assert moved.position_m[0] == 0.1
    found = {name: n for name, n in arm.counters().items() if n}
    assert found == {
        "arm_poses.left": 1, "arm_undecodable.left": 2, "arm_not_finite.left": 1, "arm_backwards.left": 1,
    }  # fmt: skip
    assert {reason for event, _, _, reason in notes(arm) if event == "refused"} == {
        "undecodable", "not_finite", "backwards",
    }  # fmt: skip


def test_the_patient_listens_to_the_arm_and_sends_its_newest_pose_with_its_age() -> None:
    scenario = resolve("live", ["patient.plant.kind=external"], None, 1.0)
    node = build_patient(scenario, [static_model()], load_movement(scenario))
    assert ("east", KEY) in node.listens()
    assert node.foreign_keys() == {KEY, "tis/PSM2/servo_cp"}
    assert node.receive(pose(1, 0.25)) == ()
    node.wake(2 * MS)
    outputs = list(node.wake(35_333_333))
    sent = [each for each in outputs if isinstance(each, Emission) and each.key == "tis/PSM2/measured_cp"]
    (message,) = [decode(each.payload, FeedbackPose) for each in sent]
    assert message.position_m.x == 0.25
    (note,) = [each.data for each in outputs if isinstance(each, Record) and each.topic == PLANT]
    assert isinstance(note, PlantNote)
    assert note.age_ns == 34_333_333
    assert node.counters()["arm_poses.left"] == 1


def test_after_the_last_tick_an_arm_that_goes_on_sends_nothing_too_fast() -> None:
    scenario = resolve("live", ["patient.plant.kind=external"], None, 0.05)
    node = build_patient(scenario, [static_model()], load_movement(scenario))
    while (due_ns := node.next_wake_ns()) is not None:
        list(node.wake(due_ns))
    for ms in range(60, 560):
        node.receive(pose(ms, 0.25))
    assert node.counters()["arm_flooded.left"] == 0


def test_without_an_external_arm_its_key_is_nobodys() -> None:
    scenario = resolve("live", (), None, 1.0)
    node = build_patient(scenario, [static_model()], load_movement(scenario))
    assert KEY not in node.foreign_keys()
    assert KEY not in [key for _, key in node.listens()]


def test_the_force_on_the_tool_comes_with_the_pose_and_goes_with_silence() -> None:
    arm = an_arm(silent_ms=250)
    found = []
    arrivals: dict[int, dict[str, Any]] = {
        0: {},
        1: {"force_n": {"x": 1, "y": -2, "z": 0.5}},
        2: {"force_n": {"x": 20_000, "y": 0, "z": 0}},
    }
    for k in range(6):
        if k in arrivals:
            arm.take(pose(100 * k, 0.1, **arrivals[k]))
        _, moved = arm.step(None, None, k, k * 100 * MS)
        assert moved is not None
        found.append(moved.force_n)
    felt = (1.0, -2.0, 0.5)
    assert found == [(0.0, 0.0, 0.0), felt, felt, felt, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    assert arm.counters()["arm_undecodable.left"] == 1
    arm.take(pose(550, 0.1, force_n=None))
    _, moved = arm.step(None, None, 6, 600 * MS)
    assert moved is not None
    assert moved.force_n == (0.0, 0.0, 0.0)


def test_with_touch_the_arms_force_goes_back_to_the_surgeon() -> None:
    settings = ["patient.plant={kind: external}", "touch={fade_after_ms: 500}"]
    scenario = resolve("live", settings, None, 1.0)
    node = build_patient(scenario, [static_model()], load_movement(scenario))
    node.receive(pose(1, 0.25, force_n={"x": 0, "y": 0, "z": 1.5}))
    outputs = [each for ms in (2, 35.4) for each in node.wake(int(ms * MS))]
    sent = [each for each in outputs if isinstance(each, Emission) and each.key == "tis/PSM2/measured_cf"]
    assert decode(sent[-1].payload, Wrench).force_n == Vector3(x=0.0, y=0.0, z=1.5)


def test_an_external_arm_has_no_spring_that_a_passive_coupling_could_know() -> None:
    with pytest.raises(InputError, match=r"patient\.plant\.kind must be servo with touch\.coupling wave"):
        resolve("live", ["patient.plant={kind: external}", "touch={coupling: wave, fade_after_ms: 500}"], None, 1.0)
