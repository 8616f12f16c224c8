"""Use of the processors during a run: by this process, other programs, and the virtual machine's host.

Counters are read at the beginning and at the end only, so the run is not disturbed.
"""

import os
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from common.host_records import PROCESSORS, ProcessorNote
from common.node import Record
from common.runtime.cgroup_quota import Quota, held_back, read_quotas
from common.runtime.clock import Clock
from common.runtime.proc_stat import ProcessorTimes, as_ranges, counts_steal, elapsed, parse_processors
from common.units import NS_PER_S

_PROC: Final = Path("/proc")


class Reading(NamedTuple):
    """Counters at one instant of run time; ``own_ns`` is the processor time of all threads so far."""

    at_ns: int
    own_ns: int
    processors: dict[int, ProcessorTimes]
    quotas: dict[str, Quota]


class ProcessorWatch:
    """Measures from its creation to `record`."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._before = _read(clock)

    def record(self) -> Record:
        """Return the record of the time since creation."""
        usable = os.sched_getaffinity(0)
        cpuinfo = _text(_PROC / "cpuinfo")
        note = processor_note(self._before, _read(self._clock), usable, cpuinfo, os.sysconf("SC_CLK_TCK"))
        return Record(PROCESSORS, note.to_ns, note)


def processor_note(
    before: Reading, after: Reading, usable: Iterable[int], cpuinfo: str, jiffies_per_s: int
) -> ProcessorNote:
    """Return the note on the time between two readings. Oracle: literal readings."""
    times = elapsed(before.processors, after.processors, usable, counts_steal(after.processors.values(), cpuinfo))
    quota = held_back(before.quotas, after.quotas)

    def ns(jiffies: int | None) -> int | None:
        return None if jiffies is None else jiffies * NS_PER_S // jiffies_per_s

    return ProcessorNote(
        from_ns=before.at_ns,
        to_ns=after.at_ns,
        processors=as_ranges(usable),
        own_ns=after.own_ns - before.own_ns,
        busy_ns=times and ns(times.busy),
        idle_ns=times and ns(times.idle),
        iowait_ns=times and ns(times.iowait),
        steal_ns=times and ns(times.steal),
        quota_processors=quota and quota.processors,
        n_periods=quota and quota.n_periods,
        n_throttled=quota and quota.n_throttled,
        throttled_ns=quota and quota.throttled_ns,
    )


def _read(clock: Clock) -> Reading:
    stat = _text(_PROC / "stat")
    return Reading(clock.now_ns(), time.process_time_ns(), parse_processors(stat), read_quotas())


def _text(path: Path) -> str:
    try:
        return path.read_text()
    except OSError:
        return ""
