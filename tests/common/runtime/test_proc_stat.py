"""Literal texts of /proc/stat: what is busy, what is idle, and when a steal of 0 is a count."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.runtime.processor_watch import ProcessorTimes, as_ranges, counts_steal, elapsed, parse_processors

#         user nice system idle iowait irq softirq steal guest guest_nice
BEFORE = """\
cpu  300 30 60 1100 14 4 8 40 0 0
cpu0 100 10 20 500 6 1 3 30 0 0
cpu1 200 20 40 600 8 3 5 10 0 0
intr 58626560 0 0
ctxt 190642515
btime 1700000000
"""
AFTER = """\
cpu  403 33 66 1150 13 5 10 66 9 0
cpu0 180 12 24 510 5 2 4 56 9 0
cpu1 223 21 42 640 8 3 6 10 0 0
"""
LONG_AGO = "cpu0 7 1 2 40\n"
VIRTUAL, BARE, ARM = "flags\t\t: fpu hypervisor sse", "flags\t\t: fpu vme sse", "Features\t: fp asimd"


def test_each_processor_has_a_row_and_the_sum_of_all_is_none() -> None:
    assert parse_processors(BEFORE) == {0: ProcessorTimes(134, 500, 6, 30), 1: ProcessorTimes(268, 600, 8, 10)}


def test_what_was_not_counted_long_ago_is_not_zero() -> None:
    assert parse_processors(LONG_AGO) == {0: ProcessorTimes(10, 40, 0, None)}
    found = elapsed(parse_processors(LONG_AGO), parse_processors("cpu0 9 1 2 90"), {0}, True)
    assert found == ProcessorTimes(2, 50, 0, None)


@pytest.mark.parametrize("text", ["", "cpu  1 2 3 4\n", "cpu0 1 2\n", "cpu0 a b c d\n", "cpufreq 1 2 3 4\n", "\n\n"])
def test_what_is_no_such_text_has_no_processors(text: str) -> None:
    assert parse_processors(text) == {}


def test_between_two_readings_only_the_processors_count_that_may_be_used() -> None:
    """iowait of processor 0 went back from 6 to 5, as the kernel warns it may: it stood still."""
    before, after = parse_processors(BEFORE), parse_processors(AFTER)
    assert elapsed(before, after, {0}, True) == ProcessorTimes(88, 10, 0, 26)
    assert elapsed(before, after, {0, 1}, True) == ProcessorTimes(115, 50, 0, 26)
    assert elapsed(before, after, {1}, False) == ProcessorTimes(27, 40, 0, None)


def test_without_the_processors_or_without_a_count_nothing_is_known() -> None:
    before, after = parse_processors(BEFORE), parse_processors(AFTER)
    assert elapsed({}, after, {0}, True) is None
    assert elapsed(before, {}, {0}, True) is None
    assert elapsed(before, after, {0, 2}, True) is None  # one came later
    assert elapsed(before, after, (), True) is None
    assert elapsed(before, before, {0, 1}, True) is None  # a sandbox that never counts


@pytest.mark.parametrize(
    ("stat", "cpuinfo", "counted"),
    [
        (BEFORE, VIRTUAL, True),
        (BEFORE, "", True),
        ("cpu0 1 2 3 4 5 6 7 0", VIRTUAL, False),
        ("cpu0 1 2 3 4 5 6 7 0", ARM, False),
        ("cpu0 1 2 3 4 5 6 7 0", "", False),
        ("cpu0 1 2 3 4 5 6 7 0", BARE, True),
        ("", VIRTUAL, False),
    ],
)
def test_no_steal_is_a_count_only_where_some_was_counted_or_no_host_can_take_any(
    stat: str, cpuinfo: str, counted: bool
) -> None:
    assert counts_steal(parse_processors(stat).values(), cpuinfo) is counted


@settings(max_examples=30)
@given(st.sets(st.integers(0, 12)))
def test_ranges_name_exactly_these_processors(numbers: set[int]) -> None:
    """Held against a set of strings, processor by processor."""
    text = as_ranges(numbers)
    named = set()
    for part in text.split(",") if text else []:
        first, *last = part.split("-")
        named |= {int(first)} if not last else set(range(int(first), int(last[0]) + 1))
    assert named == numbers
    assert text.count(",") == max(0, sum(n - 1 not in numbers for n in numbers) - 1)  # as few parts as there can be


def test_ranges_by_hand() -> None:
    assert [as_ranges(n) for n in ((), (3,), (0, 1), (6, 3, 0, 1, 2))] == ["", "3", "0-1", "0-3,6"]
