"""Emergency stops at the patient, without a network."""

import json

import pytest

from common.messages import EmergencyStop, SetPoint, Vector3
from common.node import Arrival, Emission, Record
from common.records import REJECTED
from common.safety_records import STOPS, SafetyNote, StopNote
from common.scenario.safety import Safety
from common.ticker import Ticker
from common.units import sample_instant_ns
from patient_side.driven import drive
from patient_side.estimators.hold import Hold
from patient_side.hand import Fresh, PatientHand
from patient_side.node import PatientNode
from patient_side.orientation.wrist import LEVEL as LEVEL_TURN
from patient_side.orientation.wrist import Wrist
from patient_side.playout import Playout
from patient_side.safety.emergency_stop import EmergencyStops
from patient_side.safety.safety_state import SafetyFilter, limits_of
from tests.nodes import LEFT, Stamp, a_pose, an_arrival

_KEY, _ANSWER = "tis/@tis/stop", "tis/@tis/stopped"


def _request(stop: bool, at_ns: int = 5, reason: str = "", number: int = 3) -> Arrival:
    payload = EmergencyStop(stop=stop, reason=reason, number=number).model_dump_json().encode()
    return Arrival("east", _KEY, payload, b"", at_ns)


def test_each_request_is_confirmed_and_logged_once() -> None:
    stops = EmergencyStops("tis")
    (answer, record), is_new = stops.take(_request(True, 5, "smoke"))
    assert isinstance(answer, Emission)
    assert (answer.network, answer.key) == ("east", _ANSWER)
    assert EmergencyStop.model_validate_json(answer.payload).number == 3
    assert isinstance(record, Record)
    assert record.topic == STOPS
    assert record.data == StopNote(at_ns=5, stop=True, reason="smoke")
    assert is_new
    (again,), is_new = stops.take(_request(True))
    assert isinstance(again, Emission)
    assert not is_new
    assert stops.is_stopped


def test_a_late_repeat_of_a_release_does_not_undo_a_stop() -> None:
    stops = EmergencyStops("tis")
    for stop, number in ((False, 1), (True, 2), (False, 1), (False, 1)):
        stops.take(_request(stop, number=number))
    assert stops.is_stopped
    stops.take(_request(False, number=4))
    assert not stops.is_stopped


@pytest.mark.parametrize(
    "payload", [b"", b"{}", b'{"stop": 1}', b"\xff", json.dumps({"stop": True, "reason": "x" * 201}).encode()]
)
def test_what_is_no_request_stops_nothing_and_is_rejected(payload: bytes) -> None:
    stops = EmergencyStops("tis")
    (record,), is_new = stops.take(Arrival("east", _KEY, payload, b"", 5))
    assert not is_new
    assert isinstance(record, Record)
    assert record.topic == REJECTED
    assert not stops.is_stopped
    assert stops.n_rejected == 1


def _moving(node: PatientNode, k: int) -> list[SetPoint | SafetyNote]:
    """Let sample ``k`` of a movement at 60 mm/s arrive and run tick ``k``; return set point and changes."""
    sample_ns = sample_instant_ns(k, 30)
    node.receive(an_arrival("tis/PSM2/setpoint_cp", sample_ns, Stamp(k, sample_ns, sample_ns), a_pose(0.002 * k)))
    found: list[SetPoint | SafetyNote] = []
    for output in node.wake(sample_ns + 2_000_000):
        if isinstance(output, Emission) and output.key.endswith("servo_cp"):
            found.append(SetPoint.model_validate_json(output.payload))
        elif isinstance(output, Record) and isinstance(output.data, SafetyNote):
            found.append(output.data)
    return found


def test_a_stop_holds_the_arm_while_estimates_go_on_until_the_release() -> None:
    safety = SafetyFilter(limits_of(Safety(), 30), (0.0, 0.0, 0.0))
    hand = PatientHand(LEFT, Playout(30), [Hold()], plant=None, safety=safety)
    node = PatientNode("tis", [hand], Ticker(30, 100, 2_000_000), lambda: 0)
    assert ("east", _KEY) in node.listens()
    assert ("east", "tis/PSM2/servo_cp") in node.publishes()
    places = {}
    for k in range(60):
        if k in (20, 40):
            node.receive(_request(k == 20, sample_instant_ns(k, 30) - 1, number=k))
        for one in _moving(node, k):
            if isinstance(one, SetPoint):
                places[k] = (round(one.position_m.x, 9), one.mode)
    assert places[19] == (0.038, "tracking")
    assert places[20] == places[39] == (0.038, "safe")  # 2 mm a tick are within the change allowed in one
    assert places[40] == (0.046, "resuming")
    assert places[59] == (0.118, "resuming")


def test_while_stopped_orientation_and_gripper_stay_and_garbage_ends_nothing() -> None:
    safety = SafetyFilter(limits_of(Safety(latch=True), 30), (0.0, 0.0, 0.0))
    hand = PatientHand(LEFT, Playout(30), [Hold()], plant=None, safety=safety)
    node = PatientNode("tis", [hand], Ticker(30, 100, 2_000_000), lambda: 0)
    grippers, modes = {}, {}
    for k in range(30):
        if k == 10:
            node.receive(_request(True, sample_instant_ns(k, 30) - 1, number=1))
        if k in (12, 14):
            node.receive(Arrival("east", _KEY, b"{}", b"", sample_instant_ns(k, 30) - 1))
        sample_ns = sample_instant_ns(k, 30)
        pose = a_pose(0.002 * k).model_copy(update={"gripper_rad": 0.01 * k})
        node.receive(an_arrival("tis/PSM2/setpoint_cp", sample_ns, Stamp(k, sample_ns, sample_ns), pose))
        for output in node.wake(sample_ns + 2_000_000):
            if isinstance(output, Emission) and output.key.endswith("servo_cp"):
                point = SetPoint.model_validate_json(output.payload)
                grippers[k], modes[k] = point.gripper_rad, point.mode
    assert grippers[9] == grippers[10] == grippers[29] == 0.09
    assert modes[29] == "safe"
    assert node.counters()["rejected"] == 2


def test_an_estimate_with_an_invalid_covariance_is_not_followed() -> None:
    safety = SafetyFilter(limits_of(Safety(), 30), (0.0, 0.0, 0.0))
    hand = PatientHand(LEFT, Playout(30), [Hold()], plant=None, safety=safety)
    hand.freshest = Fresh("k", 0, 0)
    where = Vector3(x=0.1, y=0.0, z=0.0)
    level = Wrist(LEVEL_TURN, 0.0)
    assert drive(hand, where, None, is_certain=False, wrist=level, t_ns=1_000).place is None
    assert drive(hand, where, None, is_certain=True, wrist=level, t_ns=33_000_000).place == (0.1, 0.0, 0.0)


def test_a_new_process_goes_on_after_the_last_stop_or_release() -> None:
    stops = EmergencyStops("tis")
    _, (_, record), _ = None, *stops.take(_request(True, number=4))
    assert isinstance(record, Record)
    assert isinstance(record.data, StopNote)
    assert EmergencyStops("tis").resume(record.data.model_dump_json().encode())
    _, (_, record), _ = None, *stops.take(_request(False, number=5))
    assert isinstance(record, Record)
    assert isinstance(record.data, StopNote)
    assert not EmergencyStops("tis").resume(record.data.model_dump_json().encode())
    for nothing in (None, b"", b"{}"):
        assert not EmergencyStops("tis").resume(nothing)
