"""The note of what lies between two readings, by literal readings and by a process that works."""

import os

from tis.common.host_records import PROCESSORS, ProcessorNote
from tis.common.runtime.clock import WallClock
from tis.common.runtime.processor_watch import ProcessorTimes, ProcessorWatch, Quota, Reading, processor_note

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
