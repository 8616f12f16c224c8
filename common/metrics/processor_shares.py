"""Shares of processor time during a run: the testbed, other programs, the virtual machine's host, idle."""

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Any, Final

from tis.common.units import NS_PER_MS, NS_PER_S

_MAX_PROCESSORS: Final = 8192  # of a Linux kernel
_MAX_RANGES_CHARS: Final = 1000  # of their list


def processor_shares(
    note: Mapping[str, Any], mates: Sequence[Mapping[str, Any] | None] = ()
) -> dict[str, Any] | None:
    """Return the summary's entry from a process's `ProcessorNote`; None for a note without a duration.

    Shares are in % of the time of the processors that the process may use, None where unknown. ``testbed_pct``,
    ``others_pct``, ``steal_pct``, ``idle_pct`` and ``iowait_pct`` add up to 100, except for the kernel's rounding to
    jiffies. ``own_pct`` is the process's own work, 100 for one processor and more for parallel threads.
    ``throttled_pct`` is the share of quota periods in which the control group was throttled, for ``throttled_ms``
    over all processors.

    ``mates`` are the notes of the testbed's other processes on this host, None for one that left no note; its time
    then cannot be told from other programs'. The work of a mate is assumed to spread evenly over the processors that
    it may use. Oracle: literal notes, and that the shares add up to 1.
    """
    wall_ns = note["to_ns"] - note["from_ns"]
    if wall_ns <= 0:
        return None
    usable = numbers_of(note["processors"])
    busy_ns, idle_ns, iowait_ns, steal_ns = (note[f"{name}_ns"] for name in ("busy", "idle", "iowait", "steal"))
    # The whole is the sum of the kernel's counters and not wall time, so that the shares add up to 1.
    known = busy_ns is not None and idle_ns is not None and iowait_ns is not None
    whole_ns = busy_ns + idle_ns + iowait_ns + (steal_ns or 0) if known else 0

    def pct(ns: float | None, of_ns: float = whole_ns) -> float | None:
        return None if ns is None or not of_ns else 100 * (ns / of_ns)

    testbed_ns = None
    if known and None not in mates:
        theirs_ns = sum(mate["own_ns"] * _overlap(numbers_of(mate["processors"]), usable) for mate in mates if mate)
        testbed_ns = min(note["own_ns"] + theirs_ns, busy_ns)  # the kernel counts the two by different clocks
    n_periods = note["n_periods"]
    return {
        "wall_s": wall_ns / NS_PER_S,
        "processors": note["processors"],
        "n_processors": len(usable),
        "own_pct": pct(note["own_ns"], wall_ns),
        "testbed_pct": pct(testbed_ns),
        "others_pct": None if testbed_ns is None else pct(busy_ns - testbed_ns),
        "steal_pct": pct(steal_ns),
        "idle_pct": pct(idle_ns),
        "iowait_pct": pct(iowait_ns),
        "throttled_pct": None if n_periods is None else pct(note["n_throttled"], max(1, n_periods)),
        "throttled_ms": None if note["throttled_ns"] is None else note["throttled_ns"] / NS_PER_MS,
        "quota_processors": note["quota_processors"],
    }


@lru_cache(maxsize=64)
def numbers_of(ranges: str) -> frozenset[int]:
    """Return the processor numbers of a list like ``0-3,6``; raises `ValueError` for anything else."""
    numbers: set[int] = set()
    for part in ranges[: _MAX_RANGES_CHARS + 1].split(",") if ranges else ():
        first, _, last = part.partition("-")
        if len(ranges) > _MAX_RANGES_CHARS or int(last or first) > _MAX_PROCESSORS:
            raise ValueError(f"processors must be at most {_MAX_PROCESSORS}")
        numbers |= set(range(int(first), int(last or first) + 1))
    return frozenset(numbers)


def _overlap(theirs: frozenset[int], ours: frozenset[int]) -> float:
    return len(theirs & ours) / len(theirs) if theirs else 1.0
