from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from common.channels import Direction
from common.scenario.network import TimelineEntry
from netem.outage import Outages

MS = 1_000_000


def _entry(at_s: float, for_s: float, direction: str = "both") -> TimelineEntry:
    raw: dict[str, Any] = {"at_s": at_s, "for_s": for_s, "direction": direction, "set": {"outage": True}}
    return TimelineEntry.model_validate(raw)


def test_edges_to_the_nanosecond() -> None:
    outages = Outages.of_timeline([_entry(10, 0.5)], "forward")
    assert not outages.holds(9_999_999_999)
    assert outages.holds(10_000_000_000)
    assert outages.holds(10_499_999_999)
    assert not outages.holds(10_500_000_000)


@pytest.mark.parametrize(
    ("at_s", "for_s", "first_ns", "stop_ns"),
    [
        (0.0, 0.001, 0, 1 * MS),
        (0.0014, 0.002, 1 * MS, 3 * MS),  # 1.4 .. 3.4 ms
        (0.0015, 0.002, 2 * MS, 4 * MS),  # 1.5 .. 3.5 ms
        (0.0052, 0.0001, 5 * MS, 6 * MS),  # shorter than a cell: one cell
        (0.1, 0.2, 100 * MS, 300 * MS),  # 0.1 + 0.2 is not 0.3 in binary
    ],
)
def test_an_entry_moves_to_the_nearest_cells(at_s: float, for_s: float, first_ns: int, stop_ns: int) -> None:
    assert Outages.of_timeline([_entry(at_s, for_s)], "forward").edges_ns == (first_ns, stop_ns)


def test_each_direction_has_its_own() -> None:
    timeline = [_entry(1, 1, "forward"), _entry(4, 1, "feedback"), _entry(7, 1)]
    s = 1_000 * MS
    assert Outages.of_timeline(timeline, "forward").edges_ns == (1 * s, 2 * s, 7 * s, 8 * s)
    assert Outages.of_timeline(timeline, "feedback").edges_ns == (4 * s, 5 * s, 7 * s, 8 * s)
    assert Outages.of_timeline([], "forward").edges_ns == ()


def test_overlapping_and_touching_entries_are_one_outage() -> None:
    timeline = [_entry(0.004, 0.002), _entry(0.001, 0.002), _entry(0.003, 0.001), _entry(0.0015, 0.0001)]
    assert Outages.of_timeline(timeline, "forward").edges_ns == (1 * MS, 6 * MS)


@settings(deadline=None, max_examples=100)
@given(
    st.lists(
        st.tuples(st.integers(0, 60), st.integers(1, 20), st.sampled_from(["forward", "feedback", "both"])),
        max_size=8,
    ),
    st.sampled_from(["forward", "feedback"]),
)
def test_agrees_with_a_table_of_cells(entries: list[tuple[int, int, str]], direction: Direction) -> None:
    out = [False] * 100
    for first, count, which in entries:
        if which in (direction, "both"):
            out[first : first + count] = [True] * count
    timeline = [_entry(first / 1000, count / 1000, which) for first, count, which in entries]
    outages = Outages.of_timeline(timeline, direction)
    for cell, expected in enumerate(out):
        for now_ns in (cell * MS, cell * MS + 1, (cell + 1) * MS - 1):
            assert outages.holds(now_ns) == expected
    assert list(outages.edges_ns) == sorted(set(outages.edges_ns))
