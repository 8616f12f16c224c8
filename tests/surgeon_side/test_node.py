import json

from common.header import Header
from common.messages import FeedbackPose, Pose
from common.node import Emission, Record
from common.records import TICKS, TRUTH, TickNote, TruthRow
from common.ticker import Ticker
from surgeon_side.node import SurgeonNode
from tests.nodes import Stamp, a_pose, a_recording, an_arrival

PERIOD_NS = 33_333_333


def _node(n_ticks: int = 5, start: int = 0, n_rows: int = 50) -> SurgeonNode:
    return SurgeonNode("tis", a_recording(n_rows, start), Ticker(30, n_ticks))


def _emissions(outputs: object) -> list[Emission]:
    return [output for output in outputs if isinstance(output, Emission)]  # type: ignore[attr-defined]


def test_sample_k_goes_out_on_both_streams_with_its_row_and_instant() -> None:
    node = _node(start=10)
    node.wake(0)
    command, arm = _emissions(node.wake(PERIOD_NS))
    assert (command.network, command.key, command.attachment) == (
        "west",
        "tis/MTML/measured_cp",
        Header(1),
    )
    assert arm.key == "tis/PSM2/setpoint_cp"
    row = a_recording(50).hands[0]
    assert Pose.model_validate_json(command.payload).sample_ns == PERIOD_NS
    sent = Pose.model_validate_json(command.payload).position_m
    assert [sent.x, sent.y, sent.z] == row.command.position_m[11].tolist()
    sent = Pose.model_validate_json(arm.payload).position_m
    assert [sent.x, sent.y, sent.z] == row.follower.position_m[11].tolist()


def test_a_departure_is_logged_with_the_moment_of_sending() -> None:
    node = _node()
    command, _ = _emissions(node.wake(250))
    (flown,) = command.on_sent(900)
    assert (flown.topic, flown.data, flown.log_ns) == (command.key, command.payload, 900)
    assert node.counters()["sent"] == 1


def test_a_missed_sample_is_counted_and_never_sent_late() -> None:
    node = _node()
    node.wake(0)
    late_ns = 3 * PERIOD_NS + 10
    outputs = node.wake(late_ns)
    assert {e.attachment for e in _emissions(outputs)} == {Header(3)}
    notes = [o.data for o in outputs if isinstance(o, Record) and o.topic == TICKS]
    assert [(n.tick, n.missed) for n in notes if isinstance(n, TickNote)] == [(1, True), (2, True), (3, False)]
    assert node.counters()["ticks_missed"] == 2
    assert node.next_wake_ns() == 4 * 10**9 // 30


def test_the_truth_is_logged_one_sample_ahead_also_over_missed_ticks() -> None:
    node = _node(n_ticks=4)
    outputs = [*node.wake(0), *node.wake(3 * PERIOD_NS + 10)]
    rows = [o.data for o in outputs if isinstance(o, Record) and o.topic == TRUTH]
    assert [row.index for row in rows if isinstance(row, TruthRow)] == [0, 1, 2, 3, 4]
    assert node.next_wake_ns() is None


def test_feedback_is_logged_as_it_arrived() -> None:
    node = _node()
    pose = a_pose(0.5)
    feedback = FeedbackPose(**pose.model_dump(), tick=4, command_sample_ns=100)
    payload = feedback.model_dump_json().encode()
    arrival = an_arrival("tis/PSM2/estimated_cp", 7_000, Stamp(4, 5_000, 6_000), payload, "west")
    (flown,) = node.receive(arrival)
    assert isinstance(flown, Record)
    assert (flown.log_ns, flown.publish_ns, flown.seq) == (7_000, 6_000, 4)
    assert json.loads(flown.data)["command_sample_ns"] == 100  # type: ignore[arg-type]
    assert set(node.listens()) == {("west", "tis/PSM2/estimated_cp"), ("west", "tis/PSM2/measured_cp")}
