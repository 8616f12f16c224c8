import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tis.common.metrics.latency import (
    latency_ms,
    latency_parts,
    lateness_us,
    round_trip_ns,
    tick_summary,
)

MS = 1_000_000


def ns(*values: int) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)


def test_parts_of_two_samples() -> None:
    # taken at 0 and 33.333333 ms; sent 50 us later; 40 ms of network; the tick begins; the estimate leaves
    parts = latency_parts(
        sample_ns=ns(0, 33_333_333),
        sent_ns=ns(50_000, 33_383_333),
        recv_ns=ns(40_050_000, 73_383_333),
        begin_ns=ns(68_700_001, 102_000_000),
        published_ns=ns(68_900_001, 102_300_000),
    )
    assert parts.surgeon.tolist() == [50_000, 50_000]
    assert parts.network.tolist() == [40_000_000, 40_000_000]
    assert parts.tick_wait.tolist() == [28_650_001, 28_616_667]
    assert parts.compute.tolist() == [200_000, 300_000]
    assert parts.end_to_end.tolist() == [68_900_001, 68_966_667]


instants = st.integers(0, 10**15)


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(instants, instants, instants, instants, instants), max_size=20))
def test_parts_add_up_to_the_nanosecond(rows: list[tuple[int, ...]]) -> None:
    parts = latency_parts(*np.array(rows, dtype=np.int64).reshape(-1, 5).T)
    total = parts.surgeon + parts.network + parts.tick_wait + parts.compute
    assert total.tolist() == parts.end_to_end.tolist()
    assert parts.end_to_end.dtype == np.int64


def test_round_trip_takes_the_first_feedback_of_each_command() -> None:
    command = ns(0, 0, 33 * MS, 100 * MS, 33 * MS)
    recv = ns(90 * MS, 120 * MS, 160 * MS, 170 * MS, 150 * MS)  # the last two overtook one another
    assert round_trip_ns(command, recv).tolist() == [90 * MS, 117 * MS, 70 * MS]


@settings(deadline=None, max_examples=50)
@given(st.lists(st.tuples(st.integers(0, 9), st.integers(0, 1000)), max_size=40))
def test_round_trip_equals_a_dictionary(feedback: list[tuple[int, int]]) -> None:
    first: dict[int, int] = {}
    for command, recv in feedback:
        first[command] = min(recv, first.get(command, recv))
    trips = round_trip_ns(ns(*(c for c, _ in feedback)), ns(*(r for _, r in feedback)))
    assert trips.tolist() == [first[command] - command for command in sorted(first)]


def test_summary_speaks_milliseconds_under_its_own_names() -> None:
    one = ns(1_500_000)
    summary = latency_ms(latency_parts(ns(0), one, 2 * one, 3 * one, 4 * one), {"round_trip": ns()})
    assert list(summary) == ["surgeon", "network", "tick_wait", "compute", "end_to_end", "round_trip"]
    assert summary["surgeon"] == {"p50": 1.5, "p95": 1.5, "p99": 1.5, "max": 1.5}
    assert summary["end_to_end"]["max"] == 6.0
    assert summary["round_trip"] == {"p50": None, "p95": None, "p99": None, "max": None}


def test_a_missed_tick_counts_but_is_not_late() -> None:
    due = np.array([2_000_000, 35_333_333, 68_666_666, 102_000_000], dtype=np.int64)
    begin = np.array([2_010_000, 35_353_333, 102_030_000, 102_030_000], dtype=np.int64)
    missed = np.array([False, False, True, False])
    assert tick_summary(30, due, begin, missed) == {
        "rate_hz": 30,
        "count": 4,
        "missed": 1,
        "lateness_us": {"p50": 20.0, "p95": 30.0, "p99": 30.0, "max": 30.0},
    }


def test_a_run_without_ticks() -> None:
    none = np.empty(0, dtype=np.int64)
    summary = tick_summary(30, none, none, np.empty(0, dtype=np.bool_))
    assert (summary["count"], summary["missed"]) == (0, 0)
    assert summary["lateness_us"] == {"p50": None, "p95": None, "p99": None, "max": None}


def test_early_is_negative() -> None:
    assert lateness_us(np.array([5_000]), np.array([3_500]))["max"] == -1.5
