"""Use of the processors during a run: by this process, other programs, and the virtual machine's host.

Counters are read at the beginning and at the end only, so the run is not disturbed.
"""

import os
import time
from collections.abc import Iterable, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple

from tis.common.host_records import PROCESSORS, ProcessorNote
from tis.common.node import Record
from tis.common.runtime.clock import Clock
from tis.common.units import NS_PER_S, NS_PER_US

# CPU quota of this process's control group: cgroup v2's cpu.max, and how often the group was throttled.
#
# Source: the kernel's Documentation/admin-guide/cgroup-v2.rst. The limits of a group and of all its ancestors
# apply, to ordinary scheduling only: real-time threads are not throttled.

_ROOT: Final = Path("/sys/fs/cgroup")
_OWN: Final = Path("/proc/self/cgroup")


class Quota(NamedTuple):
    """Quota of a group in processors, and its counters; the throttled time is summed over processors."""

    processors: float
    n_periods: int
    n_throttled: int
    throttled_ns: int


def parse_quota(cpu_max: str, cpu_stat: str) -> Quota | None:
    """Return the quota from the texts of a group's two files; None without a quota. Oracle: literal texts."""
    limit = cpu_max.split()
    if len(limit) != 2 or not all(word.isdigit() for word in limit) or not int(limit[1]):
        return None  # "max 100000"
    pairs = (line.split() for line in cpu_stat.splitlines())
    counts = {pair[0]: int(pair[1]) for pair in pairs if len(pair) == 2 and pair[1].isdigit()}
    return Quota(
        int(limit[0]) / int(limit[1]),
        counts.get("nr_periods", 0),
        counts.get("nr_throttled", 0),
        counts.get("throttled_usec", 0) * NS_PER_US,
    )


def read_quotas(root: Path = _ROOT, own: Path = _OWN) -> dict[str, Quota]:
    """Return the quotas of this process's group and of its ancestors, by path."""
    try:
        line = next(line for line in own.read_text().splitlines() if line.startswith("0::/"))
    except (OSError, StopIteration):
        return {}
    inner = Path(line.removeprefix("0::/"))
    found: dict[str, Quota] = {}
    for group in (inner, *inner.parents):
        try:
            texts = [(root / group / name).read_text() for name in ("cpu.max", "cpu.stat")]
        except OSError:
            continue  # the root group has no cpu.max, and a container does not see groups above its own
        if (quota := parse_quota(*texts)) is not None:
            found[str(group)] = quota
    return found


def held_back(before: Mapping[str, Quota], after: Mapping[str, Quota]) -> Quota | None:
    """Return the counts, between two readings, of the quota that throttled most often; of equal ones the tightest.

    None when no quota exists in both readings.
    """
    changes = [
        Quota(
            after[group].processors,
            max(0, after[group].n_periods - one.n_periods),
            max(0, after[group].n_throttled - one.n_throttled),
            max(0, after[group].throttled_ns - one.throttled_ns),
        )
        for group, one in before.items()
        if group in after
    ]
    return max(changes, key=lambda one: (one.n_throttled / max(1, one.n_periods), -one.processors), default=None)


# Parser of /proc/stat: processor times, and whether the kernel counts steal.
#
# Source: proc_stat(5). Times are counted in jiffies, whose rate is `sysconf(_SC_CLK_TCK)`: usually 10 ms each.


class ProcessorTimes(NamedTuple):
    """Jiffies since boot, of one processor or of several; ``steal`` is None where it is not counted."""

    busy: int
    idle: int
    iowait: int
    steal: int | None


def parse_processors(text: str) -> dict[int, ProcessorTimes]:
    """Return the times of each processor by its number, as far as the text contains them.

    ``busy`` is user, nice, system, irq and softirq; user includes guests. Oracle: literal texts.
    """
    found: dict[int, ProcessorTimes] = {}
    for line in text.splitlines():
        name, *words = line.split() or [""]
        number = name.removeprefix("cpu")
        if name == number or not number.isdigit() or len(words) < 4 or not all(word.isdigit() for word in words):
            continue
        user, nice, system, idle, *later = map(int, words)
        iowait, irq, softirq = (*later[:3], 0, 0, 0)[:3]
        steal = later[3] if len(later) > 3 else None  # since Linux 2.6.11
        found[int(number)] = ProcessorTimes(user + nice + system + irq + softirq, idle, iowait, steal)
    return found


def counts_steal(processors: Iterable[ProcessorTimes], cpuinfo: str) -> bool:
    """Tell whether the kernel counts steal; one that does not shows 0 as well.

    It does where some has been counted since boot, or where ``cpuinfo`` (/proc/cpuinfo) shows that this is not a
    virtual machine: only x86 has such a flag, ``hypervisor``.
    """
    if any(one.steal for one in processors):
        return True
    flags = next((line.split() for line in cpuinfo.splitlines() if line.startswith("flags")), None)
    return flags is not None and "hypervisor" not in flags


def elapsed(
    before: Mapping[int, ProcessorTimes], after: Mapping[int, ProcessorTimes], which: Iterable[int], steal: bool
) -> ProcessorTimes | None:
    """Return the jiffies between two readings, summed over the processors ``which``.

    None when a reading lacks one of these processors, or nothing was counted. ``steal``: it is counted. A counter
    that decreases, as that of iowait can, is taken as unchanged.
    """
    numbers = sorted(which)
    if not numbers or not all(number in before and number in after for number in numbers):
        return None
    pairs = [(before[number], after[number]) for number in numbers]
    busy = sum(max(0, b.busy - a.busy) for a, b in pairs)
    idle = sum(max(0, b.idle - a.idle) for a, b in pairs)
    iowait = sum(max(0, b.iowait - a.iowait) for a, b in pairs)
    taken = sum(max(0, (b.steal or 0) - (a.steal or 0)) for a, b in pairs)
    counted = steal and all(one.steal is not None for pair in pairs for one in pair)
    return ProcessorTimes(busy, idle, iowait, taken if counted else None) if busy + idle + iowait + taken else None


def as_ranges(numbers: Iterable[int]) -> str:
    """Return processor numbers in the kernel's list format: ``0-3,6``."""
    # Positions at which a run of consecutive numbers begins.
    ordered = sorted(set(numbers))
    breaks = [0, *(i for i, (one, other) in enumerate(pairwise(ordered), 1) if other > one + 1), len(ordered)]
    runs = [ordered[begin:end] for begin, end in pairwise(breaks) if begin < end]
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)


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
