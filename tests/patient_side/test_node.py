from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import asdict, replace

from tests.nodes import LEFT, Stamp, a_pose, an_arrival
from tis.common.messages import FeedbackPose, Header, Quaternion, SampledPose, decode, encode
from tis.common.node import Emission, Output, Record
from tis.common.records import ESTIMATES, FRESH, TICKS, EstimateNote, FreshNote, PhaseNote, PromptNote, TickNote
from tis.common.ticker import Ticker
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.hand import PatientHand
from tis.patient_side.node import PatientNode
from tis.patient_side.phase_lock import PhaseLock
from tis.patient_side.playout import Playout

PERIOD_NS = 33_333_333
PHASE_NS = 2_000_000
COMMAND, ARM = "tis/MTML/measured_cp", "tis/PSM2/setpoint_cp"


class Seen(NamedTuple):
    """An estimator that says how many samples of each stream it can see, as coordinates."""

    name: str = "seen"

    def initial(self) -> int:
        return 0

    def step(self, state: int, playout: Playout, now_ns: int) -> tuple[int, Estimate]:
        where = np.array([playout.command.newest, playout.arm.newest, state], dtype=float)
        return state + 1, Estimate(where, np.eye(3))


def _node(estimators: Sequence[Any] = (Seen(),), n_ticks: int = 10) -> PatientNode:
    hand = PatientHand(LEFT, Playout(30), estimators, plant=None)
    return PatientNode("tis", [hand], Ticker(30, n_ticks, PHASE_NS), lambda: 0)


def _estimates(outputs: Sequence[Output]) -> list[EstimateNote]:
    return [o.data for o in outputs if isinstance(o, Record) and isinstance(o.data, EstimateNote)]


def test_a_tick_uses_what_has_arrived_and_publishes_for_its_nominal_instant() -> None:
    node = _node()
    node.receive(an_arrival(COMMAND, 1_000, Stamp(0, 0, 500), a_pose(0.1)))
    outputs = list(node.wake(PHASE_NS + 70_000))
    (answer,) = [o for o in outputs if isinstance(o, Emission)]
    assert (answer.network, answer.key, answer.attachment) == ("east", "tis/PSM2/estimated_cp", Header(0))
    assert (answer.network, answer.key) in node.publishes()
    pose = decode(answer.payload, FeedbackPose)
    assert (pose.position_m.x, pose.position_m.y) == (0.0, -1.0)
    assert (pose.tick, pose.sample_ns, pose.command_sample_ns) == (0, PHASE_NS, 0)
    (note,) = _estimates(outputs)
    assert (note.t_ns, note.tick) == (PHASE_NS, 0)
    assert note.std_m is not None
    assert note.std_m.x == 1.0


def test_answers_are_published_before_anything_is_logged() -> None:
    kinds = [type(output) for output in _node().wake(PHASE_NS)]
    assert kinds[0] is Emission
    assert Emission not in kinds[1:]


def test_after_missed_ticks_later_arrivals_are_seen_before_the_next_tick_runs() -> None:
    node = _node()
    list(node.wake(PHASE_NS))
    late_ns = 3 * PERIOD_NS + PHASE_NS + 500
    missed = list(node.wake(late_ns))
    notes = [o.data for o in missed if isinstance(o, Record)]
    assert [(n.tick, n.missed) for n in notes if isinstance(n, TickNote)] == [(1, True), (2, True)]
    assert _estimates(missed) == []
    node.receive(an_arrival(COMMAND, 2 * PERIOD_NS, Stamp(2, 66_666_666, 1), a_pose()))
    (note,) = _estimates(list(node.wake(late_ns)))
    assert note.tick == 3
    assert note.position_m is not None
    assert note.position_m.x == 2.0


def test_the_freshest_sample_is_noted_once_and_skipped_ones_are_superseded() -> None:
    node = _node()
    for i in (0, 2, 1):
        node.receive(an_arrival(COMMAND, 1_000 + i, Stamp(i, i * 33_333_333, 1), a_pose()))
    fresh = [o.data for o in node.wake(PHASE_NS) if isinstance(o, Record) and o.topic == FRESH]
    assert fresh == [FreshNote(tick=0, hand="left", key=COMMAND, seq=2, sample_ns=66_666_666)]
    assert [o for o in node.wake(PERIOD_NS + PHASE_NS) if isinstance(o, Record) and o.topic == FRESH] == []
    assert node.counters()["superseded"] == 1


def test_without_an_estimate_nothing_is_published_but_the_tick_is_logged() -> None:
    outputs = list(_node([Hold()]).wake(PHASE_NS))
    assert not any(isinstance(o, Emission) for o in outputs)
    (note,) = _estimates(outputs)
    assert note.position_m is None
    assert any(isinstance(o, Record) and o.topic == TICKS for o in outputs)


def test_junk_duplicates_and_impossible_instants_change_no_estimate() -> None:
    node = _node([Hold()])
    node.receive(an_arrival(ARM, 1_000, Stamp(0, 0, 1), a_pose(0.3)))
    node.receive(an_arrival(ARM, 1_001, Stamp(0, 0, 1), a_pose(0.9)))
    node.receive(an_arrival(ARM, 1_002, Stamp(9, 10**18, 1), a_pose(0.9)))
    node.receive(an_arrival(ARM, 1_003, b"junk", a_pose(0.9)))
    node.receive(an_arrival(ARM, 1_004, Stamp(5, 0, 1), b"{"))
    (note,) = _estimates(list(node.wake(PHASE_NS)))
    assert note.position_m is not None
    assert note.position_m.x == 0.3
    assert node.counters()["rejected"] == 3
    assert node.counters()["duplicates"] == 0
    assert node.counters()["quarantined.conflicting"] == 1


@given(order=st.permutations(range(6)))
def test_the_order_of_arrival_between_two_ticks_changes_nothing(order: list[int]) -> None:
    node = _node([Hold(), Seen()])
    for i in order:
        key = ARM if i % 2 else COMMAND
        node.receive(an_arrival(key, 1_000, Stamp(i, i * 33_333_334, 1), a_pose(i / 10)))
    straight = _node([Hold(), Seen()])
    for i in range(6):
        key = ARM if i % 2 else COMMAND
        straight.receive(an_arrival(key, 1_000, Stamp(i, i * 33_333_334, 1), a_pose(i / 10)))
    assert _estimates(list(node.wake(PHASE_NS))) == _estimates(list(straight.wake(PHASE_NS)))


def test_no_answer_waits_for_estimators_that_are_only_logged() -> None:
    node = _node([Hold(), Seen()])
    node.receive(an_arrival(ARM, 1_000, Stamp(0, 0, 1), a_pose(0.1)))
    (hand,) = node.hands
    before, outputs = hand.states[1], iter(node.wake(PHASE_NS))
    assert isinstance(next(outputs), Emission)
    assert hand.states[1] == before
    assert {type(output) for output in outputs} == {Record}
    assert hand.states[1] != before


def test_estimates_of_each_name_lie_on_a_topic_of_their_own() -> None:
    outputs = list(_node([Hold(), Seen()]).wake(PHASE_NS))
    topics = {o.topic for o in outputs if isinstance(o, Record) and isinstance(o.data, EstimateNote)}
    assert topics == {f"{ESTIMATES}/hold", f"{ESTIMATES}/seen"}


class Broken(Seen):
    """An estimator that does not know."""

    def step(self, state: int, playout: Playout, now_ns: int) -> tuple[int, Estimate]:
        return state, Estimate(np.array([np.nan, 0.0, 0.0]), np.eye(3))


def test_an_estimate_that_is_not_finite_counts_as_missing_and_is_not_published() -> None:
    outputs = list(_node([Broken()]).wake(PHASE_NS))
    (note,) = _estimates(outputs)
    assert (note.position_m, note.std_m) == (None, None)
    assert not any(isinstance(output, Emission) for output in outputs)


SAMPLES = [a_pose(k / 10, sample_ns=k * 10**9 // 30) for k in range(8)]


def _packet(k: int, history: int) -> bytes:
    return encode(SampledPose(**asdict(SAMPLES[k]), history=tuple(SAMPLES[max(0, k - history) : k])))


@given(arrived=st.lists(st.tuples(st.integers(0, 7), st.integers(0, 3)), max_size=24), history=st.integers(0, 4))
def test_whatever_arrives_in_whatever_order_the_buffer_holds_the_union(
    arrived: list[tuple[int, int]], history: int
) -> None:
    """Each packet is a copy of a sample; lost ones are not in the list, and some may come twice."""
    node = _node([Seen()])
    for n, (k, copy) in enumerate(arrived):
        node.receive(an_arrival(ARM, 1_000 + n, Header(4 * k + copy, 0).pack(), _packet(k, history)))
    brought = {j for k, _ in arrived for j in range(max(0, k - history), k + 1)}
    arm = node.hands[0].playout.arm
    held = {k: arm.get(k) for k in range(8)}
    assert {k for k, position in held.items() if position is not None} == brought
    assert all(position is None or position[0] == k / 10 for k, position in held.items())
    counters = node.counters()
    accepted = len(arrived) - counters["duplicates"]
    assert counters["duplicates"] == len(arrived) - len(set(arrived))
    assert counters["recovered"] + accepted - counters["repeated"] == len(brought)


def test_the_first_copy_to_arrive_is_noted_and_later_ones_change_nothing() -> None:
    """Copy 1 of sample 0 (number 7, sent 20 ms after it) overtakes copy 0; then it comes too, and so does a third."""
    node = _node()
    node.receive(an_arrival(COMMAND, 40_000_000, Stamp(7, 0, 20_000_000), a_pose(0.1)))
    node.receive(an_arrival(COMMAND, 41_000_000, Stamp(0, 0, 0), a_pose(0.9)))
    outputs = list(node.wake(PHASE_NS))
    (fresh,) = [o.data for o in outputs if isinstance(o, Record) and o.topic == FRESH]
    assert fresh == FreshNote(tick=0, hand="left", key=COMMAND, seq=7, sample_ns=0)
    node.receive(an_arrival(COMMAND, 42_000_000, Stamp(9, 0, 40_000_000), a_pose(0.9)))
    assert [o for o in node.wake(PERIOD_NS + PHASE_NS) if isinstance(o, Record) and o.topic == FRESH] == []
    kept = node.hands[0].playout.command.get(0)
    assert kept is not None
    assert kept[0] == 0.1
    counters = node.counters()
    assert (counters["repeated"], counters["duplicates"], counters["superseded"]) == (2, 0, 0)


def test_what_rides_along_is_never_the_freshest_nor_the_last_arrived() -> None:
    node = _node()
    node.receive(an_arrival(ARM, 1_000, Header(5).pack(), _packet(5, 3)))
    buffer = node.hands[0].playout.arm
    assert (buffer.newest, buffer.last_arrived) == (5, 5)
    fresh = [o.data for o in node.wake(PHASE_NS) if isinstance(o, Record) and o.topic == FRESH]
    assert [note.sample_ns for note in fresh if isinstance(note, FreshNote)] == [166_666_666]
    assert (node.counters()["recovered"], node.counters()["superseded"]) == (3, 0)


def _prompt(outputs: Sequence[Output]) -> list[PromptNote]:
    return [o.data for o in outputs if isinstance(o, Record) and isinstance(o.data, PromptNote)]


def test_a_fresher_sample_is_answered_at_its_arrival_from_all_that_arrived_by_then() -> None:
    node = _node()
    node.on_arrival = True
    node.receive(an_arrival(COMMAND, 500, Stamp(0, 0, 100), a_pose()))
    assert node.next_wake_ns() == 500
    node.receive(an_arrival(ARM, 500, Stamp(0, 0, 100), a_pose()))  # with the same stamp: it counts too
    outputs = list(node.wake(700))
    (answer,) = [o for o in outputs if isinstance(o, Emission)]
    pose = decode(answer.payload, FeedbackPose)
    assert (pose.position_m.x, pose.position_m.y, pose.sample_ns, pose.command_sample_ns) == (0, 0, 500, 0)
    (note,) = _prompt(outputs)
    assert (note.t_ns, note.begin_ns, note.key, note.seq, note.answer) == (500, 700, COMMAND, 0, 0)
    assert node.next_wake_ns() == PHASE_NS
    tick = list(node.wake(PHASE_NS))
    assert [o.attachment for o in tick if isinstance(o, Emission)] == [Header(1)]
    (estimate,) = _estimates(tick)
    assert estimate.position_m is not None
    assert estimate.position_m.z == 0  # the state is that of a first step: the prompt one left none
    (fresh,) = [o.data for o in tick if isinstance(o, Record) and isinstance(o.data, FreshNote)]
    assert (fresh.seq, fresh.answer) == (0, 1)


def test_an_arrival_at_a_tick_or_an_older_sample_is_not_answered_apart() -> None:
    node = _node()
    node.on_arrival = True
    node.receive(an_arrival(COMMAND, PHASE_NS, Stamp(1, 33_333_333 // 20, 1), a_pose()))
    assert node.next_wake_ns() == PHASE_NS
    assert _prompt(list(node.wake(PHASE_NS))) == []
    node.receive(an_arrival(COMMAND, PHASE_NS + 5, Stamp(0, 0, 1), a_pose()))
    assert node.next_wake_ns() == PERIOD_NS + PHASE_NS


def test_after_the_last_tick_nothing_is_answered() -> None:
    node = _node(n_ticks=1)
    node.on_arrival = True
    list(node.wake(PHASE_NS))
    node.receive(an_arrival(COMMAND, PHASE_NS + 5, Stamp(0, 0, 1), a_pose()))
    assert node.next_wake_ns() is None


def test_answers_carry_the_orientation_of_the_arms_newest_pose_not_the_masters() -> None:
    node = _node()
    turned = replace(a_pose(), orientation=Quaternion(x=1, y=0, z=0, w=0), gripper_rad=0.25)
    node.receive(an_arrival(ARM, 500, Stamp(1, 1000, 1), turned))
    node.receive(an_arrival(ARM, 600, Stamp(0, 0, 1), a_pose()))
    node.receive(an_arrival(COMMAND, 700, Stamp(2, 2000, 1), a_pose()))
    (answer,) = [o for o in node.wake(PHASE_NS) if isinstance(o, Emission)]
    pose = decode(answer.payload, FeedbackPose)
    assert (pose.orientation.x, pose.gripper_rad, pose.command_sample_ns) == (1, 0.25, 2000)


def test_a_shift_of_the_phase_holds_from_the_next_tick_on_and_is_logged() -> None:
    node = _node(n_ticks=60)
    node.phase_lock = PhaseLock(30)
    for k in range(60):
        for i in range(3):  # the arm's, too: only what is fresher counts
            key = COMMAND if i else ARM
            node.receive(an_arrival(key, k * 10**9 // 30 + 1_000_000 + i, Stamp(k, k * 10**9 // 30, 1), a_pose()))
        due_ns = node.next_wake_ns()
        assert due_ns is not None
        outputs = list(node.wake(due_ns))
        notes = [o.data for o in outputs if isinstance(o, Record) and isinstance(o.data, PhaseNote)]
        assert len(notes) == (k == 29)
        (tick,) = [o.data for o in outputs if isinstance(o, Record) and isinstance(o.data, TickNote)]
        assert tick.due_ns == due_ns == k * 10**9 // 30 + (2_000_000 if k < 30 else 1_333_333)


def test_a_patient_that_comes_back_ticks_from_now_on() -> None:
    node = _node()
    node.join(0, 5 * PERIOD_NS)
    assert node.next_wake_ns() == 166_666_666 + PHASE_NS
    outputs = list(node.wake(166_666_666 + PHASE_NS))
    (answer,) = [o for o in outputs if isinstance(o, Emission)]
    assert answer.attachment == Header(5)
    assert node.counters()["ticks_missed"] == 0
