"""What the kernel counts of each processor: the text of /proc/stat, and whether its steal is a count at all.

Source: proc_stat(5). Times are counted in jiffies, as `sysconf(_SC_CLK_TCK)` has them: 10 ms as a rule.
"""

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple


class ProcessorTimes(NamedTuple):
    """Jiffies since the start, of one processor or of several; ``steal`` is None where none is counted."""

    busy: int
    idle: int
    iowait: int
    steal: int | None


def parse_processors(text: str) -> dict[int, ProcessorTimes]:
    """Return the times of each processor by its number; none of a text that holds none.

    ``busy`` is user, nice, system, irq and softirq; a guest's time is in user already. Oracle: literal texts.
    """
    found: dict[int, ProcessorTimes] = {}
    for line in text.splitlines():
        name, *words = line.split() or [""]
        number = name.removeprefix("cpu")
        if name == number or not number.isdigit() or len(words) < 4 or not all(word.isdigit() for word in words):
            continue
        user, nice, system, idle, *later = map(int, words)
        iowait, irq, softirq = (*later[:3], 0, 0, 0)[:3]
        steal = later[3] if len(later) > 3 else None  # not before Linux 2.6.11
        found[int(number)] = ProcessorTimes(user + nice + system + irq + softirq, idle, iowait, steal)
    return found


def counts_steal(processors: Iterable[ProcessorTimes], cpuinfo: str) -> bool:
    """Tell whether a steal of 0 means that nothing was taken. A kernel that counts none shows 0 as well.

    It means so where some has been counted since the start, or where ``cpuinfo`` (/proc/cpuinfo) tells that this is
    no virtual machine: x86 names that flag ``hypervisor``, other processors do not tell.
    """
    if any(one.steal for one in processors):
        return True
    flags = next((line.split() for line in cpuinfo.splitlines() if line.startswith("flags")), None)
    return flags is not None and "hypervisor" not in flags


def elapsed(
    before: Mapping[int, ProcessorTimes], after: Mapping[int, ProcessorTimes], which: Iterable[int], steal: bool
) -> ProcessorTimes | None:
    """Return the jiffies between two readings, added up over processors ``which``.

    None when the readings do not have all of these processors, or nothing was counted. ``steal``: it is a count. A
    counter that goes back, as that of iowait may, stands still.
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
    """Return processors as the kernel lists them: ``0-3,6``."""
    ordered = sorted(set(numbers))
    breaks = [0, *(i for i, (one, other) in enumerate(pairwise(ordered), 1) if other > one + 1), len(ordered)]
    runs = [ordered[begin:end] for begin, end in pairwise(breaks) if begin < end]
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
