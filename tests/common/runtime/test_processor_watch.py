"""Literal cpu.max and cpu.stat, and groups within groups as folders."""

import os
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.host_records import PROCESSORS, ProcessorNote
from tis.common.runtime.clock import WallClock
from tis.common.runtime.processor_watch import (
    ProcessorTimes,
    ProcessorWatch,
    Quota,
    Reading,
    as_ranges,
    counts_steal,
    elapsed,
    held_back,
    parse_processors,
    parse_quota,
    processor_note,
    read_quotas,
)

STAT = "usage_usec 5000\nuser_usec 3000\nsystem_usec 2000\nnr_periods 40\nnr_throttled 30\nthrottled_usec 2500\n"


def test_a_quota_is_so_many_processors() -> None:
    assert parse_quota("50000 100000\n", STAT) == Quota(0.5, 40, 30, 2_500_000)
    assert parse_quota("300000 100000\n", "usage_usec 1\n") == Quota(3.0, 0, 0, 0)


@pytest.mark.parametrize("limit", ["max 100000\n", "", "50000\n", "50000 0\n", "a b\n"])
def test_what_is_no_quota_limits_nothing(limit: str) -> None:
    assert parse_quota(limit, STAT) is None


def _group(folder: Path, limit: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cpu.max").write_text(limit)
    (folder / "cpu.stat").write_text(STAT)


def test_the_groups_around_a_process_limit_it_too(tmp_path: Path) -> None:
    own = tmp_path / "own"
    own.write_text("2:cpu:/elsewhere\n0::/slice/unit/inner\n")
    root = tmp_path / "fs"
    _group(root / "slice", "150000 100000")
    _group(root / "slice" / "unit", "max 100000")
    (root / "slice" / "unit" / "inner").mkdir()
    _group(root / "beside", "10000 100000")
    assert {name: quota.processors for name, quota in read_quotas(root, own).items()} == {"slice": 1.5}
    own.write_text("0::/\n")  # a container sees its own group as the outermost
    _group(root, "50000 100000")
    assert [quota.processors for quota in read_quotas(root, own).values()] == [0.5]


@pytest.mark.parametrize("text", [None, "1:cpu:/\n", "0::/gone\n", "0::/../outside\n", ""])
def test_where_no_group_is_seen_there_is_no_quota(tmp_path: Path, text: str | None) -> None:
    own = tmp_path / "own"
    if text is not None:
        own.write_text(text)
    assert read_quotas(tmp_path / "fs", own) == {}


def test_the_group_that_held_back_most_often_counts() -> None:
    before = {"a": Quota(2.0, 100, 10, 50), "b": Quota(0.5, 100, 10, 50), "gone": Quota(0.1, 0, 0, 0)}
    after = {"a": Quota(2.0, 140, 40, 950), "b": Quota(0.5, 140, 12, 60), "new": Quota(0.1, 9, 9, 9)}
    assert held_back(before, after) == Quota(2.0, 40, 30, 900)
    assert held_back(before, before) == Quota(0.1, 0, 0, 0)  # none did: the tightest
    assert held_back({}, after) is None


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


MS = 1_000_000
VIRTUAL = "flags : fpu hypervisor"


def test_a_note_holds_the_differences_in_ns() -> None:
    """100 jiffies a second: each is 10 ms."""
    before = Reading(-5 * MS, 40 * MS, {0: ProcessorTimes(10, 20, 0, 3)}, {"g": Quota(0.5, 1, 1, 7)})
    after = Reading(995 * MS, 90 * MS, {0: ProcessorTimes(60, 43, 1, 29)}, {"g": Quota(0.5, 11, 4, 9)})
    assert processor_note(before, after, {0}, VIRTUAL, 100) == ProcessorNote(
        from_ns=-5 * MS, to_ns=995 * MS, processors="0", own_ns=50 * MS,
        busy_ns=500 * MS, idle_ns=230 * MS, iowait_ns=10 * MS, steal_ns=260 * MS,
        quota_processors=0.5, n_periods=10, n_throttled=3, throttled_ns=2,
    )  # fmt: skip


def test_what_is_not_counted_is_not_zero() -> None:
    nowhere, later = (Reading(at_ns, at_ns // 2, {}, {}) for at_ns in (0, 10 * MS))
    note = processor_note(nowhere, later, {0, 1}, "", 100)
    assert (note.own_ns, note.processors) == (5 * MS, "0-1")
    assert {note.busy_ns, note.idle_ns, note.iowait_ns, note.steal_ns} == {None}
    assert {note.quota_processors, note.n_periods, note.n_throttled, note.throttled_ns} == {None}

    none, some = (Reading(i, 0, {0: ProcessorTimes(7 * i, 9 * i, 0, 0)}, {}) for i in (0, 1))
    note = processor_note(none, some, {0}, VIRTUAL, 100)
    assert (note.busy_ns, note.idle_ns, note.steal_ns) == (70 * MS, 90 * MS, None)
    assert processor_note(none, some, {0}, "flags : fpu", 100).steal_ns == 0


def test_a_process_notes_its_own_work_and_where_it_may_run() -> None:
    watch = ProcessorWatch(WallClock(0))
    before = os.times()
    sum(i * i for i in range(300_000))
    used_s = sum(os.times()[:2]) - sum(before[:2])
    record = watch.record()
    note = record.data
    assert isinstance(note, ProcessorNote)
    assert record.topic == PROCESSORS
    assert record.log_ns == note.to_ns > note.from_ns
    assert note.own_ns >= max(1, (used_s - 0.02) * 1e9)  # os.times counts in jiffies
    assert str(min(os.sched_getaffinity(0))) in note.processors
