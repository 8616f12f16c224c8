"""Links whose packets wait for a transmission, come twice, or find no room."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import KEY, link, offer, packet
from tis.netem.link.link import Link
from tis.netem.link.packet import Packet

MS = 1_000_000
OTHER_KEY = "tis/PSM2/setpoint_cp"
# 7 bytes of payload and 20 of attachment: 27 bytes at 27 kbit/s take 8 ms
RATE: dict[str, Any] = {"kbit_s": 27}


def _left(made: Link, until_ns: int) -> list[tuple[str, int, int | None]]:
    return [(due.name, due.seq, due.release_ns) for due in made.release(until_ns)]


def test_keys_of_a_link_wait_for_each_other() -> None:
    made = link(forward={"rate": RATE, "delay": {"kind": "constant", "delay_ms": 100}})
    assert offer(made, packet(0, 0), 0).release_ns is None  # the queue has still to say
    offer(made, packet(0, 0, OTHER_KEY), 0)
    offer(made, packet(1 * MS, 1), 1 * MS)
    assert made.held == 3
    assert made.queue_depth()[0] == 3
    assert made.next_release_ns() == 8 * MS  # the first transmission ends
    assert _left(made, 1_000 * MS) == [(KEY, 0, 108 * MS), (OTHER_KEY, 0, 116 * MS), (KEY, 1, 124 * MS)]
    assert made.held == 0


def test_the_time_in_the_queue_is_told() -> None:
    made = link(forward={"rate": RATE})
    for seq in range(3):
        offer(made, packet(0, seq), 0)
    assert [due.queued_ns for due in made.release(100 * MS)] == [8 * MS, 16 * MS, 24 * MS]


def test_a_rule_shares_a_rate_of_its_own_or_that_of_the_link() -> None:
    def rule(rate: Any) -> list[dict[str, Any]]:
        return [{"key": OTHER_KEY, "direction": "forward", "pipeline": {"rate": rate}}]

    for rate, expected in ((RATE, 8), ("link", 16), (None, 0)):
        made = link(forward={"rate": RATE}, rules=rule(rate))
        offer(made, packet(0, 0), 0)
        offer(made, packet(0, 0, OTHER_KEY), 0)
        assert (OTHER_KEY, 0, expected * MS) in _left(made, 100 * MS)


def test_a_rate_of_the_link_that_has_none_delays_nothing() -> None:
    made = link(rules=[{"key": OTHER_KEY, "direction": "forward", "pipeline": {"rate": "link"}}])
    assert offer(made, packet(5, 0, OTHER_KEY), 5).release_ns == 5


def test_what_finds_the_queue_full_is_dropped() -> None:
    full = {"rate": {**RATE, "queue": {"kind": "tail_drop", "max_packets": 2}}}
    made = link(forward=full)
    assert [offer(made, packet(0, seq), 0).outcome for seq in range(3)] == ["deliver", "deliver", "queue_full"]
    assert made.dropped["queue_full"] == 1
    made.release(8 * MS)
    assert offer(made, packet(8 * MS, 3), 8 * MS).outcome == "deliver"


def test_what_gives_way_to_a_higher_priority_is_dropped_by_the_full_queue() -> None:
    made = link(forward={"rate": {**RATE, "queue": {"kind": "priority", "max_packets": 2}}})
    for seq, priority in ((0, 5), (1, 7), (2, 1)):
        one = packet(0, seq)
        made.offer(one.key, one.attachment, len(one.payload), 0, one, priority)
    due = made.release(100 * MS)
    assert [(one.seq, one.departure) for one in due] == [(1, "queue_full"), (0, "released"), (2, "released")]
    assert (made.dropped["queue_full"], made.held, made.queue_depth()) == (1, 0, (0, 0))


def test_codel_drops_what_has_waited_too_long() -> None:
    codel = {"kind": "codel", "target_ms": 10, "interval_ms": 50}
    made = link(forward={"rate": {**RATE, "queue": codel}})
    due: list[Packet] = []
    for k in range(2_000):  # twice what the rate carries
        offer(made, packet(k * 4 * MS, k), k * 4 * MS)
        due += made.release(k * 4 * MS)
    due += made.release(100_000 * MS)
    departures = [one.departure for one in due]
    assert departures.count("codel") == made.dropped["codel"] > 500
    assert made.offered == made.released + sum(made.dropped.values())
    late = [one.queued_ns for one in due[1500:] if one.departure == "released"]
    assert sorted(late)[len(late) // 2] < 60 * MS  # tail drop would let them wait for 8 s


def test_a_change_of_the_rate_holds_from_its_instant() -> None:
    made = link(forward={"rate": RATE}, timeline=[{"at_s": 1, "set": {"rate": {"kbit_s": 2.7}}}])
    offer(made, packet(0, 0), 0)
    assert _left(made, 999 * MS) == [(KEY, 0, 8 * MS)]
    offer(made, packet(1_000 * MS, 1), 1_000 * MS)
    assert _left(made, 2_000 * MS) == [(KEY, 1, 1_080 * MS)]


def test_a_copy_has_a_delay_of_its_own_and_is_counted_apart() -> None:
    stages: dict[str, Any] = {
        "duplicate": {"p_duplicate": 1},
        "delay": {"kind": "uniform", "low_ms": 0, "high_ms": 10},
        "ordering": "reorder",
    }
    made = link(forward=stages)
    fates = [offer(made, packet(0, seq), 0) for seq in range(200)]
    assert all(fate.n_copies == 1 for fate in fates)
    due = made.release(100 * MS)
    assert sorted((one.seq, one.copy_index) for one in due) == [(seq, k) for seq in range(200) for k in (0, 1)]
    by_copy = [{one.seq: one.release_ns for one in due if one.copy_index == k} for k in (0, 1)]
    assert [fate.release_ns for fate in fates] == [by_copy[0][seq] for seq in range(200)]
    assert sum(by_copy[0][seq] != by_copy[1][seq] for seq in range(200)) > 190
    assert (made.offered, made.copied, made.released) == (200, 200, 400)


@pytest.mark.parametrize("bound", [{"max_packets": 3}, {"max_mb": 3 * 1027e-6}])
def test_a_full_buffer_drops_what_comes_or_what_is_oldest(bound: dict[str, Any]) -> None:
    slow = {"delay": {"kind": "constant", "delay_ms": 1000}}
    newest = link(forward=slow, buffer=bound)
    assert [offer(newest, packet(0, seq), 0).outcome for seq in range(5)] == ["deliver"] * 3 + ["overflow"] * 2
    oldest = link(forward=slow, buffer={**bound, "policy": "drop_oldest"})
    assert [offer(oldest, packet(seq, seq), seq).outcome for seq in range(5)] == ["deliver"] * 5
    assert oldest.next_release_ns() is not None
    evicted = oldest.release(5)
    assert [(due.seq, due.departure) for due in evicted] == [(0, "evicted"), (1, "evicted")]
    assert [due.seq for due in oldest.release(2_000 * MS)] == [2, 3, 4]
    assert (oldest.held, oldest.held_bytes, oldest.dropped["evicted"]) == (0, 0, 2)


def test_the_bound_on_a_buffer_is_one_on_memory() -> None:
    """Payload and attachment are the least of it for small messages, and queries keep the buffer they came in."""
    made = link(forward={"delay": {"kind": "constant", "delay_ms": 9}})
    for name, n_bytes, memory in (
        (KEY, 0, 1_000), (KEY, 256, 1_256), (KEY, 16_384, 17_384), (KEY, 16_385, 26_385),
        (f"query {KEY}", 10, 10_010), (f"reply {KEY}", 10, 10_010),
    ):  # fmt: skip
        before = made.held_bytes
        made.offer(name, b"", n_bytes, 0, None)
        assert made.held_bytes - before == memory
    made.release(9 * MS)
    assert made.held_bytes == 0


_STEPS = st.lists(
    st.tuples(st.integers(0, 6 * MS), st.sampled_from([KEY, OTHER_KEY, None]), st.integers(0, 30)), max_size=60
)


@settings(deadline=None, max_examples=120)
@given(
    _STEPS,
    st.sampled_from(["tail_drop", "codel"]),
    st.sampled_from(["drop_newest", "drop_oldest"]),
    st.sampled_from([2, 5, 1000]),
    st.sampled_from(["fifo", "reorder", "drop_late"]),
)
def test_conservation_whatever_comes(
    steps: list[tuple[int, str | None, int]], queue: str, policy: str, room: int, ordering: str
) -> None:
    control = {"target_ms": 5, "interval_ms": 20} if queue == "codel" else {}
    made = link(
        forward={
            "loss": {"kind": "burst", "p_loss": 0.2, "mean_burst": 2},
            "duplicate": {"p_duplicate": 0.3},
            "rate": {**RATE, "queue": {"kind": queue, "max_packets": 4, **control}},
            "delay": {"kind": "uniform", "low_ms": 0, "high_ms": 10},
            "ordering": ordering,
        },
        rules=[{"key": OTHER_KEY, "direction": "forward", "pipeline": {"rate": "link", "ordering": ordering}}],
        buffer={"max_packets": room, "policy": policy},
        states={
            "kind": "cycle",
            "states": [
                {"name": "up", "for_s": 0.02},
                {"name": "slow", "for_s": 0.02, "forward": {"rate": {"kbit_s": 10}}},
                {"name": "down", "for_s": 0.01, "forward": {"outage": True}},
            ],
        },
    )
    now_ns = 0
    out: list[Packet] = []
    for gap_ns, key, seq in steps:
        now_ns += gap_ns
        if key is None:
            out += made.release(now_ns)
        else:
            offer(made, packet(now_ns, seq, key), now_ns)
        assert made.offered + made.copied == made.released + sum(made.dropped.values()) + made.held
        assert 0 <= made.held <= room
        assert made.held_bytes == made.held * 1027
        next_ns = made.next_release_ns()
        assert (next_ns is None) == (made.held == 0 and not made._dropped)
    out += made.release(now_ns + 10_000 * MS)
    assert (made.held, made.held_bytes) == (0, 0)
    assert made.next_release_ns() is None
    released = [due for due in out if due.departure == "released"]
    assert all(due.release_ns is not None and due.release_ns >= due.offered_ns for due in released)
    assert sum(due.departure == "released" for due in out) == made.released
