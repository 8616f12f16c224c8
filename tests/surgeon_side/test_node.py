import json

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import asdict
from scipy.spatial.transform import Rotation

from tests.nodes import Stamp, a_pose, a_recording, an_arrival
from tis.common.messages import FeedbackPose, Header, Pose, PredictedPose, SampledPose, Vector3, decode, encode
from tis.common.node import Emission, Record
from tis.common.records import TICKS, TRUTH, TickNote, TruthRow
from tis.common.ticker import Ticker
from tis.surgeon_side.motion import RecordedMotion
from tis.surgeon_side.node import ONCE, Redundancy, SurgeonNode, rotation_vector

PERIOD_NS = 33_333_333


def _node(n_ticks: int = 5, start: int = 0, n_rows: int = 50, redundancy: Redundancy = ONCE) -> SurgeonNode:
    return SurgeonNode("tis", RecordedMotion(a_recording(n_rows, start)), Ticker(30, n_ticks), redundancy)


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
    streams = [(command.network, command.key), (arm.network, arm.key)]
    assert list(node.publishes()) == [*streams, ("west", "tis/PSM2/predicted_cp")]
    row = a_recording(50).hands[0]
    assert decode(command.payload, Pose).sample_ns == PERIOD_NS
    sent = decode(command.payload, Pose).position_m
    assert [sent.x, sent.y, sent.z] == row.command.position_m[11].tolist()
    sent = decode(arm.payload, Pose).position_m
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
    feedback = FeedbackPose(**asdict(pose), tick=4, command_sample_ns=100)
    payload = encode(feedback)
    arrival = an_arrival("tis/PSM2/estimated_cp", 7_000, Stamp(4, 5_000, 6_000), payload, "west")
    (flown,) = node.receive(arrival)
    assert isinstance(flown, Record)
    assert (flown.log_ns, flown.publish_ns, flown.seq) == (7_000, 6_000, 4)
    assert json.loads(flown.data)["command_sample_ns"] == 100  # type: ignore[arg-type]
    assert set(node.listens()) == {("west", "tis/PSM2/estimated_cp"), ("west", "tis/PSM2/measured_cp")}


def _commands(outputs: object) -> list[tuple[int, int, list[int]]]:
    """Return number, sample instant and the instants of the history of each command that goes out."""
    found = []
    for emission in _emissions(outputs):
        if emission.key == "tis/MTML/measured_cp":
            pose = decode(emission.payload, SampledPose)
            assert isinstance(emission.attachment, Header)
            found.append((emission.attachment.seq, pose.sample_ns, [earlier.sample_ns for earlier in pose.history]))
    return found


def test_copies_leave_at_their_instants_with_numbers_of_their_own() -> None:
    node = _node(n_ticks=2, redundancy=Redundancy(copies=3, spacing_ns=20_000_000))
    seen = []
    while (due_ns := node.next_wake_ns()) is not None:
        seen.append((due_ns, _commands(node.wake(due_ns))))
    assert seen == [
        (0, [(0, 0, [])]),
        (20_000_000, [(1, 0, [])]),
        (33_333_333, [(2, 33_333_333, [])]),
        (40_000_000, [(3, 0, [])]),
        (53_333_333, [(4, 33_333_333, [])]),
        (73_333_333, [(5, 33_333_333, [])]),
    ]


def test_copies_without_spacing_leave_at_once_as_packets_of_equal_bytes() -> None:
    node = _node(redundancy=Redundancy(copies=4))
    packets = _emissions(node.wake(0))
    assert [p.attachment for p in packets if p.key == "tis/PSM2/setpoint_cp"] == [Header(seq) for seq in range(4)]
    assert len({(p.key, p.payload) for p in packets}) == 2


def test_history_holds_the_samples_before_oldest_first() -> None:
    node = _node(redundancy=Redundancy(history=2))
    sent = [_commands(node.wake(k * 10**9 // 30))[0] for k in range(4)]
    assert sent == [
        (0, 0, []),
        (1, 33_333_333, [0]),
        (2, 66_666_666, [0, 33_333_333]),
        (3, 100_000_000, [33_333_333, 66_666_666]),
    ]


def test_without_history_the_bytes_are_those_of_a_plain_pose() -> None:
    command, _ = _emissions(_node().wake(0))
    assert "history" not in json.loads(command.payload)
    assert encode(decode(command.payload, Pose)) == command.payload


def test_a_missed_sample_has_no_copies_no_history_and_leaves_its_numbers_free() -> None:
    """Nobody woke the node between samples 0 and 3: samples 1 and 2 are gone, and so are the first copies of 0."""
    node = _node(redundancy=Redundancy(copies=2, spacing_ns=10_000_000, history=3))
    node.wake(0)
    outputs = node.wake(3 * PERIOD_NS + 10)
    assert _commands(outputs) == [(6, 100_000_000, [0])]
    assert node.counters()["ticks_missed"] == 2
    assert node.counters()["copies_missed"] == 3
    assert _commands(node.wake(110_000_000)) == [(7, 100_000_000, [0])]


def test_a_copy_that_is_a_little_late_still_leaves() -> None:
    node = _node(redundancy=Redundancy(copies=2, spacing_ns=10_000_000))
    node.wake(0)
    assert _commands(node.wake(PERIOD_NS + 9_000_000)) == [(1, 0, []), (2, PERIOD_NS, [])]
    assert node.counters()["copies_missed"] == 0


def test_traffic_counts_payload_and_attachment_of_what_was_sent() -> None:
    node = _node(redundancy=Redundancy(copies=2))
    packets = _emissions(node.wake(0))
    for packet in packets:
        packet.on_sent(5)
    n_bytes = sum(len(p.payload) + 20 for p in packets if p.key == "tis/MTML/measured_cp")
    counters = node.counters()
    assert (counters["sent"], counters["sent_packets.tis/MTML/measured_cp"]) == (4, 2)
    assert counters["sent_bytes.tis/MTML/measured_cp"] == n_bytes


@given(st.lists(st.floats(-1, 1), min_size=4, max_size=4).filter(lambda q: sum(x * x for x in q) > 0.01))
def test_rotation_vectors_are_scipys(values: list[float]) -> None:
    quaternion = (np.array(values) / np.linalg.norm(values)).tolist()
    found = rotation_vector(quaternion)
    expected = Rotation.from_quat(quaternion)
    between = Rotation.from_rotvec([found.x, found.y, found.z]).inv() * expected
    assert between.magnitude() < 1e-7
    assert np.hypot(found.x, np.hypot(found.y, found.z)) <= np.pi + 1e-9


def test_no_rotation_is_the_zero_vector() -> None:
    assert rotation_vector((0.0, 0.0, 0.0, 1.0)) == rotation_vector((0.0, 0.0, 0.0, -1.0)) == Vector3(x=0, y=0, z=0)


def test_a_surgeon_that_comes_back_goes_on_where_the_hand_is_now() -> None:
    """Numbers are those of the plan, and the arm's place meanwhile is in the log."""
    redundancy = Redundancy(copies=2, spacing_ns=10_000_000)
    node = _node(n_ticks=20, redundancy=redundancy)
    node.join(7, 10 * PERIOD_NS + 5)
    assert node.next_wake_ns() == 10 * PERIOD_NS + 3 + 10_000_000  # the copy of sample 10, which was never taken
    outputs = [*node.wake(10 * PERIOD_NS + 3 + 10_000_000), *node.wake(11 * PERIOD_NS + 3)]
    sent = _emissions(outputs)
    assert [emission.attachment for emission in sent] == [Header(22), Header(22)]
    assert [decode(emission.payload, Pose).sample_ns for emission in sent] == [366_666_666] * 2
    rows = [o.data for o in outputs if isinstance(o, Record) and isinstance(o.data, TruthRow)]
    assert [row.index for row in rows] == list(range(13))
    assert node.counters()["ticks_missed"] == 0


def test_the_display_is_published_and_logged_once_the_arm_has_answered() -> None:
    node = _node(n_ticks=3)
    node.wake(0)
    feedback = FeedbackPose(**asdict(a_pose(0.5)), tick=0, command_sample_ns=0)
    payload = encode(feedback)
    node.receive(an_arrival("tis/PSM2/estimated_cp", 6_000, Stamp(0, 5_000, 6_000), payload, "west"))
    assert len(_emissions(node.wake(PERIOD_NS))) == 2, "an estimate is not the arm"
    node.receive(an_arrival("tis/PSM2/measured_cp", PERIOD_NS + 7_000, Stamp(0, 5_000, 6_000), payload, "west"))
    *samples, display = _emissions(node.wake(2 * PERIOD_NS + 1))
    assert [one.key for one in samples] == ["tis/MTML/measured_cp", "tis/PSM2/setpoint_cp"]
    assert (display.network, display.key, display.attachment) == ("west", "tis/PSM2/predicted_cp", Header(2))
    shown = decode(display.payload, PredictedPose)
    assert (shown.shown_m, shown.round_trip_ns) == (feedback.position_m, PERIOD_NS + 7_000)
    x_m = a_recording(50).hands[0].follower.position_m[:3, 0]
    assert shown.position_m.x == 0.5 + x_m[2] - x_m[0]
    (flown,) = display.on_sent(900)
    assert (flown.topic, flown.data, flown.log_ns, flown.seq) == (display.key, display.payload, 900, 2)
    assert node.counters()["sent"] == 0, "a display is not sent to the patient"


def test_a_fast_display_shows_every_ninth_tick_and_knows_all_commands() -> None:
    recording = a_recording(50, rate_hz=1000)
    node = SurgeonNode("tis", RecordedMotion(recording), Ticker(1000, 30))
    payload = encode(FeedbackPose(**asdict(a_pose(0.5)), tick=0, command_sample_ns=0))
    node.wake(0)
    node.receive(an_arrival("tis/PSM2/measured_cp", 400_000, Stamp(0, 0, 0), payload, "west"))
    woken = [node.wake(k * 1_000_000) for k in range(1, 30)]
    sent = [one for outputs in woken for one in _emissions(outputs)]
    shown = [decode(one.payload, PredictedPose) for one in sent if one.key.endswith("predicted_cp")]
    assert [display.tick for display in shown] == [9, 18, 27]
    x_m = recording.hands[0].follower.position_m[:, 0]
    assert [display.position_m.x for display in shown] == [0.5 + x_m[k] - x_m[0] for k in (9, 18, 27)]
