"""Stalls: nothing is sent for a while, then everything that waited leaves."""

from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.link.test_changing_rate import driven, released_ns
from tests.netem.making import KEY, link
from tis.common.scenario.control import OutageRequest
from tis.netem.control.replay import apply_entries

MS = 1_000_000
S = 1_000 * MS


def _stall(at_s: float, for_s: float, **network: Any) -> dict[str, Any]:
    return {"timeline": [{"at_s": at_s, "for_s": for_s, "set": {"stall": True}}], **network}


def test_what_waits_leaves_together_at_the_end_in_order() -> None:
    made = link(**_stall(0.1, 0.3))
    arrivals = [(at_ms * MS, 100) for at_ms in (50, 99, 100, 250, 399, 400, 450)]
    assert released_ns(made, arrivals, S) == [ms * MS for ms in (50, 99, 400, 400, 400, 400, 450)]
    assert (made.released, sum(made.dropped.values()), made.held) == (7, 0, 0)


def test_the_delay_counts_from_the_end_of_the_stall() -> None:
    made = link(**_stall(0.1, 0.3, forward={"delay": {"kind": "constant", "delay_ms": 20}}))
    # what was under way before the stall arrives meanwhile: a stall is where the rate is, before the delay
    arrivals = [(at_ms * MS, 100) for at_ms in (90, 100, 399, 400)]
    assert released_ns(made, arrivals, S) == [ms * MS for ms in (110, 420, 420, 420)]


def test_a_queue_fills_in_a_stall_and_drains_at_its_rate() -> None:
    """100 bytes take 10 ms at 80 kbit/s; one is being sent when the stall begins, and goes on afterwards."""
    queue = {"kind": "tail_drop", "max_packets": 4}
    made = link(**_stall(0.015, 0.1, forward={"rate": {"kbit_s": 80, "queue": queue}}))
    due = driven(made, [(at_ms * MS, 100, KEY) for at_ms in (0, 10, 20, 30, 40, 50, 60)], S)
    assert [(one.seq, one.release_ns) for one in due] == [
        (0, 10 * MS), (1, 120 * MS), (2, 130 * MS), (3, 140 * MS), (4, 150 * MS),
    ]  # fmt: skip
    assert made.dropped["queue_full"] == 2


def test_recurring_stalls_lose_nothing() -> None:
    outages = [{"kind": "periodic", "every_s": 1, "for_s": 0.2, "effect": "stall", "direction": "forward"}]
    made = link(outages=outages)
    arrivals = [(at_ms * MS, 50) for at_ms in range(0, 3000, 100)]
    expected = [ms if ms < 1000 or ms % 1000 >= 200 else ms - ms % 1000 + 200 for ms in range(0, 3000, 100)]
    assert released_ns(made, arrivals, 4 * S) == [ms * MS for ms in expected]
    assert not any(made.dropped.values())


def test_a_state_may_stall() -> None:
    cycle = [{"name": "up", "for_s": 0.9}, {"name": "handover", "for_s": 0.1, "forward": {"stall": True}}]
    made = link(states={"kind": "cycle", "states": cycle})
    assert released_ns(made, [(850 * MS, 9), (950 * MS, 9), (1001 * MS, 9)], 2 * S) == [850 * MS, S, 1001 * MS]


def test_an_outage_within_a_stall_loses_what_is_offered_meanwhile() -> None:
    made = link(timeline=[
        {"at_s": 0.1, "for_s": 0.3, "set": {"stall": True}}, {"at_s": 0.2, "for_s": 0.1, "set": {"outage": True}},
    ])  # fmt: skip
    due = driven(made, [(at_ms * MS, 9, KEY) for at_ms in (150, 250, 350)], S)
    assert [(one.seq, one.release_ns) for one in due] == [(0, 400 * MS), (2, 400 * MS)]
    assert made.dropped["outage"] == 1


def test_a_stall_asked_for_live_holds_for_what_waits() -> None:
    made = link(forward={"rate": {"kbit_s": 80}})
    for _ in range(2):
        made.offer(KEY, b"", 100, 0, None)
    entry = OutageRequest(for_ms=50, effect="stall").as_set().entry(0.004)
    apply_entries({"forward": made}, [entry], False, 4 * MS + 5)
    # from the next whole ms, 5, to 55: the first message had half of its 10 ms
    assert [due.release_ns for due in driven(made, [], S)] == [60 * MS, 70 * MS]


def test_a_stall_without_an_end_holds_everything() -> None:
    made = link(timeline=[{"at_s": 0.1, "set": {"stall": True}}])
    assert driven(made, [(at_ms * MS, 9, KEY) for at_ms in (150, 250)], 1000 * S) == []
    assert (made.held, made.released) == (2, 0)


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.integers(1, 400), st.integers(1, 300)), max_size=4),
    st.lists(st.tuples(st.integers(0, 90), st.integers(1, 400)), min_size=1, max_size=25),
    st.sampled_from([None, 64.0, 1544.0]),
)
def test_a_stall_is_time_that_does_not_count(
    stalls: list[tuple[int, int]], gaps: list[tuple[int, int]], kbit_s: float | None
) -> None:
    """With the time of the stalls taken out, messages leave as without stalls."""
    timeline, marks, at_ms = [], [], 0
    for gap_ms, for_ms in stalls:
        begin_ms = at_ms + gap_ms
        at_ms = begin_ms + for_ms
        marks.append((begin_ms * MS, for_ms * MS))
        timeline.append({"at_s": begin_ms / 1000, "for_s": for_ms / 1000, "set": {"stall": True}})
    arrivals, now_ns = [], 0
    for gap_ms, n_bytes in gaps:
        now_ns += gap_ms * MS + 7
        arrivals.append((now_ns, n_bytes))
    rate: dict[str, Any] = {} if kbit_s is None else {"rate": {"kbit_s": kbit_s}}

    def served(ns: int) -> int:
        """Return the time outside stalls until ``ns``."""
        return ns - sum(min(max(ns - begin_ns, 0), length_ns) for begin_ns, length_ns in marks)

    found = released_ns(link(forward=rate, timeline=timeline), arrivals, 10**18)
    without = released_ns(link(forward=rate), [(served(at_ns), n) for at_ns, n in arrivals], 10**18)
    assert [served(ns) for ns in found if ns is not None] == pytest.approx(without, abs=1)
