"""Orientation and gripper in answers, set points and records, tick by tick."""

from math import degrees

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.nodes import LEFT, Stamp, an_arrival
from tis.common.messages import FeedbackPose, Pose, Quaternion, SetPoint, Vector3, decode, encode
from tis.common.node import Emission, Output, Record
from tis.common.records import ORIENTATIONS, OrientationNote, PromptNote
from tis.common.scenario.patient import OrientationMethod
from tis.common.scenario.safety import Safety
from tis.common.ticker import Ticker
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.hand import PatientHand
from tis.patient_side.node import PatientNode
from tis.patient_side.orientation.wrist import WristEstimate
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.safety.limits import limits_of
from tis.patient_side.safety.safety_state import SafetyFilter

PHASE_NS = 2_000_000
ARM = "tis/PSM2/setpoint_cp"
NEWEST = Quaternion(x=0.0, y=0.0, z=0.0, w=2.0)  # of any length


def about_z(angle_deg: float) -> np.ndarray:
    half = np.radians(angle_deg) / 2
    return np.array([0.0, 0.0, np.sin(half), np.cos(half)])


class Spin:
    """A method that states 3 degrees about z for each sample period of age, once a sample is there."""

    name: OrientationMethod = "tangent_ls"

    def __init__(self, offset_deg: float = 0.0) -> None:
        self.offset_deg = offset_deg

    def estimate(self, arm: SourceBuffer, age_samples: float) -> WristEstimate:
        if arm.newest < 0:
            return WristEstimate(None)
        covariance = np.diag([1e-4, 4e-4, 9e-4])
        return WristEstimate(about_z(self.offset_deg + 3 * age_samples), covariance, 0.1 * age_samples, 0.0025)


def instant(k: int) -> int:
    return k * 10**9 // 30


def a_sample(k: int, orientation: Quaternion = NEWEST) -> Pose:
    where = Vector3(x=0.001 * k, y=0.0, z=0.0)
    return Pose(sample_ns=instant(k), position_m=where, orientation=orientation, gripper_rad=0.5)


def a_node(method: Spin | None, on_arrival: bool = False, **safety: object) -> PatientNode:
    limits = limits_of(Safety.model_validate({"workspace_m": 10.0, **safety}), 30)
    methods = () if method is None else (method,)
    hand = PatientHand(LEFT, Playout(30), [Hold()], None, SafetyFilter(limits, (0.0, 0.0, 0.0)), methods)
    return PatientNode("tis", [hand], Ticker(30, 1000, PHASE_NS), lambda: 0, on_arrival=on_arrival)


def give(node: PatientNode, k: int, late_ns: int = 1000) -> list[Output]:
    return list(node.receive(an_arrival(ARM, instant(k) + late_ns, Stamp(k, instant(k), 1), a_sample(k))))


def tick(node: PatientNode, k: int) -> list[Output]:
    return list(node.wake(instant(k) + PHASE_NS))


def message(outputs: list[Output], channel: str) -> Pose:
    (found,) = [o for o in outputs if isinstance(o, Emission) and o.key.endswith(channel)]
    model = SetPoint if channel == "servo_cp" else FeedbackPose
    return decode(found.payload, model)


def degrees_of(pose: Pose) -> float:
    turn = pose.orientation
    return degrees(2 * np.arctan2(turn.z, turn.w))


def test_the_answer_carries_the_estimate_and_the_record_its_deviations() -> None:
    node = a_node(Spin())
    give(node, 0)
    tick(node, 0)
    outputs = tick(node, 1)
    age = 1 + PHASE_NS * 30 / 1e9
    for channel in ("estimated_cp", "servo_cp"):
        assert degrees_of(message(outputs, channel)) == pytest.approx(3 * age)
        assert message(outputs, channel).gripper_rad == pytest.approx(0.1 * age)
    (record,) = [o for o in outputs if isinstance(o, Record) and o.topic.startswith(ORIENTATIONS)]
    note = record.data
    assert record.topic == f"{ORIENTATIONS}/tangent_ls"
    assert isinstance(note, OrientationNote)
    assert (note.tick, note.hand, note.method) == (1, "left", "tangent_ls")
    assert note.std_rad is not None
    assert (note.std_rad.x, note.std_rad.y, note.std_rad.z) == pytest.approx((0.01, 0.02, 0.03))
    assert note.gripper_std_rad == pytest.approx(0.05)


def test_without_a_method_the_answer_carries_the_newest_sample_and_level_before_one() -> None:
    node = a_node(None)
    give(node, 0)
    pose = message(tick(node, 0), "estimated_cp")
    assert pose.orientation == NEWEST
    assert pose.gripper_rad == 0.5


def test_a_sample_of_no_orientation_is_no_sample_of_it() -> None:
    node = a_node(None)
    (hand,) = node.hands
    none = Quaternion(x=0.0, y=0.0, z=0.0, w=0.0)
    node.receive(an_arrival(ARM, 1000, Stamp(0, 0, 1), a_sample(0, none)))
    assert hand.playout.arm.newest == 0
    assert hand.playout.arm.orientation(0) is None


def test_an_answer_at_an_arrival_carries_the_estimate_of_its_instant() -> None:
    node = a_node(Spin(), on_arrival=True)
    give(node, 0)
    list(node.wake(1000))
    tick(node, 0)
    tick(node, 1)
    give(node, 1, late_ns=10_000_000)
    outputs = list(node.wake(instant(1) + 10_000_000))
    age = 10_000_000 * 30 / 1e9
    assert degrees_of(message(outputs, "estimated_cp")) == pytest.approx(3 * age, abs=1e-6)
    (note,) = [o.data for o in outputs if isinstance(o, Record) and isinstance(o.data, PromptNote)]
    assert note.turn_std_rad is not None
    assert note.turn_std_rad.z == pytest.approx(0.03)
    assert note.gripper_rad == pytest.approx(0.1 * age, abs=1e-6)


def test_after_a_break_the_set_point_turns_slowly_until_it_meets_the_estimate() -> None:
    method = Spin()
    node = a_node(method, resume_turn_deg_s=90.0, cautious_ms=0.0, resume_ms=100.0, hold_age_ms=500.0)
    for k in range(5):
        give(node, k)
        tick(node, k)
    before = degrees_of(message(tick(node, 5), "servo_cp"))
    for k in range(6, 60):  # too old from 0.6 s on: orientation and gripper stay
        outputs = tick(node, k)
    held = message(outputs, "servo_cp")
    assert held.mode != "tracking"  # type: ignore[attr-defined]
    assert degrees_of(held) > before
    method.offset_deg = 90.0
    stopped_deg, stopped_rad, turned = degrees_of(held), held.gripper_rad, []
    for k in range(60, 130):
        give(node, k)
        turned.append(message(tick(node, k), "servo_cp"))
    angles = [stopped_deg, *map(degrees_of, turned)]
    steps = np.abs(np.diff(angles))
    assert steps.max() <= 90.0 / 30 + 1e-6
    assert steps[0] == pytest.approx(90.0 / 30)  # it begins at once, and does not jump
    assert angles[-1] == pytest.approx(90.0 + 3 * PHASE_NS * 30 / 1e9)
    assert abs(turned[0].gripper_rad - stopped_rad) <= np.radians(3.0) + 1e-9
    # met: from then on it follows a jump of the estimate at once
    method.offset_deg = 60.0
    give(node, 130)
    assert degrees_of(message(tick(node, 130), "servo_cp")) == pytest.approx(60.0 + 3 * PHASE_NS * 30 / 1e9)


def test_a_new_process_turns_on_from_where_the_arm_was_left() -> None:
    node = a_node(Spin(), resume_turn_deg_s=90.0)
    x, y, z, w = about_z(-30.0).tolist()
    left = SetPoint(
        sample_ns=0, position_m=Vector3(x=0.0, y=0.0, z=0.0), orientation=Quaternion(x=x, y=y, z=z, w=w),
        gripper_rad=0.2, hand="left", tick=0, mode="tracking", age_ns=0,
    )  # fmt: skip
    node.resume({"tis/PSM2/servo_cp": encode(left)})
    waiting = message(tick(node, 0), "servo_cp")
    assert degrees_of(waiting) == pytest.approx(-30.0)
    assert waiting.gripper_rad == 0.2
    give(node, 1)
    resuming = message(tick(node, 1), "servo_cp")
    assert degrees_of(resuming) == pytest.approx(-27.0)
    assert Rotation.from_quat([resuming.orientation.z, 0, 0, resuming.orientation.w]).magnitude() > 0.4


def test_two_hands_turn_apart() -> None:
    node, other = a_node(Spin()), a_node(Spin(45.0))
    give(node, 0)
    give(other, 0)
    one, two = (message(tick(each, 0), "estimated_cp") for each in (node, other))
    assert degrees_of(two) - degrees_of(one) == pytest.approx(45.0)
