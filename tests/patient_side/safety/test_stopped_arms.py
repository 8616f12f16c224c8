"""Arms that are stopped, released or latched: what the set points do, without a network."""

from msgspec.structs import replace

from tests.nodes import LEFT, Stamp, a_pose, an_arrival
from tests.patient_side.safety.stop_requests import RELEASE_KEY, STOP_KEY, a_release, a_stop
from tis.common.messages import SetPoint, Vector3, decode
from tis.common.node import Arrival, Emission, Record
from tis.common.safety_records import SafetyNote
from tis.common.scenario.safety import Safety
from tis.common.stop_messages import LATCH
from tis.common.ticker import Ticker
from tis.common.units import sample_instant_ns
from tis.patient_side.driven import drive
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.hand import Fresh, PatientHand
from tis.patient_side.node import PatientNode
from tis.patient_side.orientation.wrist import LEVEL, Wrist
from tis.patient_side.playout import Playout
from tis.patient_side.safety.limits import limits_of
from tis.patient_side.safety.safety_state import SafetyFilter


def _moving(node: PatientNode, k: int) -> list[SetPoint | SafetyNote]:
    """Let sample ``k`` of a movement at 60 mm/s arrive and run tick ``k``; return set point and changes."""
    sample_ns = sample_instant_ns(k, 30)
    node.receive(an_arrival("tis/PSM2/setpoint_cp", sample_ns, Stamp(k, sample_ns, sample_ns), a_pose(0.002 * k)))
    found: list[SetPoint | SafetyNote] = []
    for output in node.wake(sample_ns + 2_000_000):
        if isinstance(output, Emission) and output.key.endswith("servo_cp"):
            found.append(decode(output.payload, SetPoint))
        elif isinstance(output, Record) and isinstance(output.data, SafetyNote):
            found.append(output.data)
    return found


def test_a_stop_holds_the_arm_while_estimates_go_on_until_the_release() -> None:
    safety = SafetyFilter(limits_of(Safety(), 30), (0.0, 0.0, 0.0))
    hand = PatientHand(LEFT, Playout(30), [Hold()], plant=None, safety=safety)
    node = PatientNode("tis", [hand], Ticker(30, 100, 2_000_000), lambda: 0)
    assert {("east", STOP_KEY), ("east", RELEASE_KEY)} <= set(node.listens())
    assert ("east", "tis/PSM2/servo_cp") in node.publishes()
    places = {}
    for k in range(60):
        at_ns = sample_instant_ns(k, 30) - 1
        if k in (20, 40):
            node.receive(a_stop(20, at_ns) if k == 20 else a_release(40, ends=20, at_ns=at_ns))
        for one in _moving(node, k):
            if isinstance(one, SetPoint):
                places[k] = (round(one.position_m.x, 9), one.mode)
    assert places[19] == (0.038, "tracking")
    assert places[20] == places[39] == (0.038, "safe")  # 2 mm a tick are within the change allowed in one
    assert places[40] == (0.046, "resuming")
    assert places[59] == (0.118, "resuming")


def test_a_latched_arm_resumes_after_a_release_of_the_latch() -> None:
    safety = SafetyFilter(limits_of(Safety(latch=True), 30), (0.0, 0.0, 0.0))
    hand = PatientHand(LEFT, Playout(30), [Hold()], plant=None, safety=safety)
    node = PatientNode("tis", [hand], Ticker(30, 300, 2_000_000), lambda: 0)
    modes = {}
    for k in range(280):
        sample_ns = sample_instant_ns(k, 30)
        if k == 250:
            node.receive(a_release(1, ends=LATCH, at_ns=sample_ns - 1))
        if not 10 <= k < 200:  # an outage of more than 5 s
            stamp = Stamp(k, sample_ns, sample_ns)
            node.receive(an_arrival("tis/PSM2/setpoint_cp", sample_ns, stamp, a_pose(0.002)))
        for output in node.wake(sample_ns + 2_000_000):
            if isinstance(output, Emission) and output.key.endswith("servo_cp"):
                modes[k] = decode(output.payload, SetPoint).mode
    assert (modes[9], modes[199], modes[249]) == ("tracking", "safe", "safe")
    assert modes[250] == "resuming"
    assert node.counters()["releases"] == 1


def test_while_stopped_orientation_and_gripper_stay_and_garbage_ends_nothing() -> None:
    safety = SafetyFilter(limits_of(Safety(latch=True), 30), (0.0, 0.0, 0.0))
    hand = PatientHand(LEFT, Playout(30), [Hold()], plant=None, safety=safety)
    node = PatientNode("tis", [hand], Ticker(30, 100, 2_000_000), lambda: 0)
    grippers, modes = {}, {}
    for k in range(30):
        if k == 10:
            node.receive(a_stop(1, sample_instant_ns(k, 30) - 1))
        if k in (12, 14):
            node.receive(Arrival("east", STOP_KEY, b"{}", b"", sample_instant_ns(k, 30) - 1))
        sample_ns = sample_instant_ns(k, 30)
        pose = replace(a_pose(0.002 * k), gripper_rad=0.01 * k)
        node.receive(an_arrival("tis/PSM2/setpoint_cp", sample_ns, Stamp(k, sample_ns, sample_ns), pose))
        for output in node.wake(sample_ns + 2_000_000):
            if isinstance(output, Emission) and output.key.endswith("servo_cp"):
                point = decode(output.payload, SetPoint)
                grippers[k], modes[k] = point.gripper_rad, point.mode
    assert grippers[9] == grippers[10] == grippers[29] == 0.09
    assert modes[29] == "safe"
    assert node.counters()["rejected"] == 2


def test_an_estimate_with_an_invalid_covariance_is_not_followed() -> None:
    safety = SafetyFilter(limits_of(Safety(), 30), (0.0, 0.0, 0.0))
    hand = PatientHand(LEFT, Playout(30), [Hold()], plant=None, safety=safety)
    hand.freshest = Fresh("k", 0, 0)
    where = Vector3(x=0.1, y=0.0, z=0.0)
    level = Wrist(LEVEL, 0.0)
    assert drive(hand, where, None, is_certain=False, wrist=level, t_ns=1_000).place is None
    assert drive(hand, where, None, is_certain=True, wrist=level, t_ns=33_000_000).place == (0.1, 0.0, 0.0)
