"""Parser of /proc/stat: processor times, and whether the kernel counts steal.

Source: proc_stat(5). Times are counted in jiffies, whose rate is `sysconf(_SC_CLK_TCK)`: usually 10 ms each.
"""

from collections.abc import Iterable, Mapping
from itertools import pairwise
from typing import NamedTuple


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
    ordered = sorted(set(numbers))
    breaks = [0, *(i for i, (one, other) in enumerate(pairwise(ordered), 1) if other > one + 1), len(ordered)]
    runs = [ordered[begin:end] for begin, end in pairwise(breaks) if begin < end]
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)
