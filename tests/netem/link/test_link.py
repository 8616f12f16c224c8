from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import KEY, link, offer, packet, pipeline
from tis.common.channels import Direction
from tis.common.streams import Address
from tis.netem.link.link import Link
from tis.netem.link.packet import Fate, Packet
from tis.netem.stages.pipeline_draws import Draws

MS = 1_000_000
OTHER_KEY = "tis/PSM2/setpoint_cp"
SPREAD: dict[str, Any] = {"kind": "uniform", "low_ms": 0, "high_ms": 10}


def _constant(delay_ms: float) -> dict[str, Any]:
    return {"delay": {"kind": "constant", "delay_ms": delay_ms}}


def _seqs(due: list[Packet]) -> list[int]:
    return [one.seq for one in due]


def _balanced(made: Link) -> bool:
    return made.offered + made.copied == made.released + sum(made.dropped.values()) + made.held


def test_a_packet_leaves_at_its_instant_and_not_a_nanosecond_before() -> None:
    made = link(forward=_constant(40))
    first = packet(1_000, seq=0)
    assert made.next_release_ns() is None
    assert offer(made, first, 1_000) == Fate(0, "deliver", 40 * MS, 40 * MS + 1_000)
    assert made.next_release_ns() == 40 * MS + 1_000
    assert made.release(40 * MS + 999) == []
    assert made.held == 1
    (left,) = made.release(40 * MS + 1_000)
    assert (left.item, left.name, left.seq, left.departure) == (first, KEY, 0, "released")
    assert (left.offered_ns, left.release_ns, left.queued_ns, left.copy_index) == (1_000, 40 * MS + 1_000, 0, 0)
    assert made.held == 0
    assert made.next_release_ns() is None


def test_equal_instants_leave_in_the_order_of_offering() -> None:
    made = link(forward=_constant(1))
    for seq in (5, 3, 4):
        offer(made, packet(0, seq=seq), 0)
    assert _seqs(made.release(1 * MS)) == [5, 3, 4]


def test_sequence_numbers_of_foreign_packets_are_counted_by_key() -> None:
    made = link()
    offers = [(KEY, None), (KEY, 70), (OTHER_KEY, None), (KEY, None), ("foreign/key", None), (KEY, None)]
    fates = [offer(made, packet(0, seq, key), 0) for key, seq in offers]
    assert [fate.seq for fate in fates] == [0, 70, 0, 1, 0, 2]
    assert [fate.outcome for fate in fates] == ["deliver"] * 4 + ["refused"] + ["deliver"]


def test_a_duplicate_shares_the_fate_of_its_original() -> None:
    made = link(forward={"delay": SPREAD, "loss": {"kind": "bernoulli", "p_loss": 0.5}, "ordering": "reorder"})
    for seq in range(50):
        original, copy = (offer(made, packet(0, seq), 0) for _ in range(2))
        assert original == copy


def test_causes_of_drops_are_counted_apart() -> None:
    made = link(
        buffer={"max_packets": 2},
        forward=_constant(1),
        rules=[
            {
                "key": OTHER_KEY,
                "direction": "forward",
                "pipeline": {"loss": {"kind": "bernoulli", "p_loss": 1}},
            }
        ],
        timeline=[{"at_s": 1, "for_s": 1, "set": {"outage": True}}],
    )
    s = 1_000 * MS
    outcomes = [
        offer(made, packet(0, 0, "elsewhere"), 0).outcome,
        offer(made, packet(0, 0, OTHER_KEY), 0).outcome,
        offer(made, packet(s, 0), 1 * s).outcome,
        offer(made, packet(s, 0, "elsewhere"), 1 * s).outcome,
        *(offer(made, packet(2 * s, seq), 2 * s).outcome for seq in (1, 2, 3)),
    ]
    assert outcomes == ["refused", "loss", "outage", "refused", "deliver", "deliver", "overflow"]
    assert _seqs(made.release(2 * s + 1 * MS)) == [1, 2]
    assert made.counters() == {
        "forward.offered": 7,
        "forward.copied": 0,
        "forward.released": 2,
        "forward.dropped.loss": 1,
        "forward.dropped.outage": 1,
        "forward.dropped.refused": 2,
        "forward.dropped.overflow": 1,
        "forward.dropped.queue_full": 0,
        "forward.dropped.late": 0,
        "forward.dropped.codel": 0,
        "forward.dropped.evicted": 0,
        "forward.held_at_end": 0,
        "forward.most_held": 2,
        "forward.flipped_bits": 0,
    }
    assert offer(made, packet(2 * s, 4), 2 * s).outcome == "deliver"  # there is room again


def test_an_outage_does_not_touch_packets_in_flight() -> None:
    made = link(forward=_constant(100), timeline=[{"at_s": 0.05, "for_s": 1, "set": {"outage": True}}])
    assert offer(made, packet(0, 0), 49 * MS + 999_999).outcome == "deliver"
    assert offer(made, packet(0, 1), 50 * MS).outcome == "outage"
    assert _seqs(made.release(200 * MS)) == [0]


def _run_at_1_khz(ordering: str, n: int = 2_000) -> list[Packet]:
    made = link(forward={"delay": SPREAD, "ordering": ordering})
    out: list[Packet] = []
    for seq in range(n):
        offer(made, packet(seq * MS, seq), seq * MS)
        out += made.release(seq * MS)
    return out + made.release((n + 10) * MS)


def test_fifo_keeps_the_order() -> None:
    assert _seqs(_run_at_1_khz("fifo")) == list(range(2_000))


def test_reorder_permutes() -> None:
    due = _run_at_1_khz("reorder")
    assert _seqs(due) != list(range(2_000))
    assert sorted(_seqs(due)) == list(range(2_000))
    assert all(one.departure == "released" for one in due)


def test_drop_late_drops_what_reorder_overtakes() -> None:
    due = _run_at_1_khz("drop_late")
    newest, overtaken = -1, set()
    for one in _run_at_1_khz("reorder"):
        if one.seq < newest:
            overtaken.add(one.seq)
        newest = max(newest, one.seq)
    assert {one.seq for one in due if one.departure == "late"} == overtaken
    assert len(overtaken) > 500


def test_what_is_lost_upstream_or_sent_on_another_key_changes_no_fate() -> None:
    noisy: dict[str, Any] = {
        "delay": SPREAD,
        "loss": {"kind": "bernoulli", "p_loss": 0.3},
        "ordering": "reorder",
    }
    alone, crowded = link(forward=noisy), link(forward=noisy)
    expected = {seq: offer(alone, packet(seq * MS, seq), seq * MS) for seq in range(3_000)}
    for seq in range(0, 3_000, 3):
        offer(crowded, packet(seq * MS, seq, OTHER_KEY), seq * MS)
        offer(crowded, packet(seq * MS), seq * MS)
        assert offer(crowded, packet(seq * MS, seq), seq * MS) == expected[seq]


@pytest.mark.parametrize("direction", ["forward", "feedback"])
@pytest.mark.parametrize("key", [KEY, OTHER_KEY])
def test_delays_are_those_of_the_key_in_its_direction(direction: Direction, key: str) -> None:
    noisy: dict[str, Any] = {"delay": SPREAD, "ordering": "reorder"}
    made = link(direction, forward=noisy, feedback=noisy)
    seqs = np.arange(100)
    delay_ns = Draws(pipeline(**noisy), Address(7, direction, key), {}).decide_many(seqs, seqs, 7).delay_ns
    assert [offer(made, packet(0, seq, key), 0).delay_ns for seq in range(100)] == delay_ns.tolist()


class _Step(NamedTuple):
    """After ``gap_ns``: a packet, or with ``key`` None a release."""

    gap_ns: int
    key: str | None
    seq: int | None


_STEPS = st.lists(
    st.builds(
        _Step,
        gap_ns=st.one_of(st.just(0), st.integers(0, 5 * MS)),
        key=st.sampled_from([KEY, OTHER_KEY, "camera/image", None]),
        seq=st.one_of(st.none(), st.integers(0, 30)),
    ),
    max_size=60,
)


@settings(deadline=None, max_examples=150)
@given(
    _STEPS,
    st.sampled_from(["fifo", "reorder", "drop_late"]),
    st.sampled_from([3, 200_000]),
    st.sampled_from([0.0, 0.4]),
)
def test_conservation_order_and_never_early(steps: list[_Step], ordering: str, max_held: int, p_loss: float) -> None:
    made = link(
        buffer={"max_packets": max_held},
        forward={"delay": SPREAD, "loss": {"kind": "bernoulli", "p_loss": p_loss}, "ordering": ordering},
        timeline=[{"at_s": 0.02, "for_s": 0.02, "set": {"outage": True}}],
    )
    now_ns = 0
    pending: dict[int, tuple[Fate, int]] = {}  # by the packet's identity
    packets = []  # keeps them alive, so that identities stay apart
    out: list[tuple[str, Packet]] = []

    def let_go(at_ns: int) -> None:
        for due in made.release(at_ns):
            fate, offered_ns = pending.pop(id(due.item))
            assert due.release_ns is not None
            assert offered_ns + fate.delay_ns <= due.release_ns <= at_ns
            assert due.release_ns == fate.release_ns
            out.append((due.item.key, due))
        next_ns = made.next_release_ns()
        assert next_ns is None or next_ns > at_ns

    for step in steps:
        now_ns += step.gap_ns
        if step.key is None:
            let_go(now_ns)
        else:
            one = packet(now_ns, step.seq, step.key)
            packets.append(one)
            fate = offer(made, one, now_ns)
            if fate.outcome == "deliver":
                pending[id(one)] = fate, now_ns
            assert (fate.outcome == "refused") == (step.key == "camera/image")
        assert _balanced(made)
        assert made.held == len(pending) <= max_held
    let_go(now_ns + 10**9)
    assert not pending
    assert _balanced(made)
    assert made.offered == len(packets)
    instants = [due.release_ns for _, due in out if due.release_ns is not None]
    assert len(instants) == len(out)
    assert instants == sorted(instants)
    for key in (KEY, OTHER_KEY):
        sent = [due for k, due in out if k == key and due.departure == "released"]
        if ordering != "reorder":
            assert [due.item.recv_ns for due in sent] == sorted(due.item.recv_ns for due in sent)
    assert ordering == "drop_late" or made.dropped["late"] == 0


@pytest.mark.parametrize("topology", ["teleoperation", "observer"])
def test_observer_delays_the_arm_only(topology: str) -> None:
    made = link(topology=topology, forward=_constant(200))
    command, arm = offer(made, packet(0, 0), 0), offer(made, packet(0, 0, OTHER_KEY), 0)
    assert command.delay_ns == (0 if topology == "observer" else 200 * MS)
    assert arm.delay_ns == 200 * MS


def test_prepared_flows_decide_as_unprepared_ones() -> None:
    stages: dict[str, Any] = {
        "loss": {"kind": "bernoulli", "p_loss": 0.3},
        "delay": {"kind": "uniform", "low_ms": 1, "high_ms": 9},
    }
    prepared, plain = link(forward=stages), link(forward=stages)
    prepared.prepare([KEY, "somebody/else"])
    assert prepared.counters() == plain.counters()
    for seq in range(200):
        assert offer(prepared, packet(seq, seq), seq) == offer(plain, packet(seq, seq), seq)


def test_the_order_that_a_change_asked_for_ends_with_it() -> None:
    change = {"at_s": 1, "for_s": 1, "set": {"ordering": "reorder"}}
    made = link(forward={"delay": SPREAD, "ordering": "fifo"}, timeline=[change])
    out: list[Packet] = []
    for seq in range(3_000):
        offer(made, packet(seq * MS, seq), seq * MS)
        out += made.release(seq * MS)
    early, meanwhile, later = (
        [due.seq for due in out if a <= due.offered_ns < b]
        for a, b in ((0, 1_000 * MS), (1_000 * MS, 2_000 * MS), (2_000 * MS, 3_000 * MS))
    )
    assert early == sorted(early)
    assert later == sorted(later)
    assert meanwhile != sorted(meanwhile)


def test_drop_late_begins_anew_with_a_sender_that_is_restarted() -> None:
    made = link(forward={"delay": {"kind": "constant", "delay_ms": 1}, "ordering": "drop_late"})
    for at_ms, seq in enumerate([0, 1, 2, 0, 1, 2]):
        offer(made, packet(at_ms * MS, seq), at_ms * MS)
    due = made.release(100 * MS)
    assert [(one.seq, one.departure) for one in due] == [(seq, "released") for seq in (0, 1, 2, 0, 1, 2)]
