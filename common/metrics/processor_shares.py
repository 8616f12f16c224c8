"""Shares of processor time during a run: the testbed, other programs, the virtual machine's host, idle."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

from tis.common.units import NS_PER_MS, NS_PER_S

_MAX_PROCESSORS: Final = 8192  # of a Linux kernel
_MAX_RANGES_CHARS: Final = 1000  # of their list


@dataclass(frozen=True)
class ProcessorShares:
    """Shares, 0 to 1, of the time of the processors that a process may use; None where unknown.

    ``testbed``, ``others``, ``steal``, ``idle`` and ``iowait`` add up to 1, except for the kernel's rounding to
    jiffies. ``own`` is the process's own work in processors, above 1 for parallel threads. ``throttled`` is the share
    of quota periods in which the control group was throttled, for ``throttled_ns`` over all processors.
    """

    wall_ns: int
    processors: str
    own: float
    testbed: float | None
    others: float | None
    steal: float | None
    idle: float | None
    iowait: float | None
    quota_processors: float | None
    throttled: float | None
    throttled_ns: int | None

    @property
    def unused(self) -> float | None:
        """Return the share of idle time, with or without a pending disk access."""
        return None if self.idle is None or self.iowait is None else self.idle + self.iowait

    def summary(self) -> dict[str, Any]:
        """Return the summary's entry, in percent."""
        names = ("own", "testbed", "others", "steal", "idle", "iowait", "throttled")
        return {
            "wall_s": self.wall_ns / NS_PER_S,
            "processors": self.processors,
            "n_processors": len(numbers_of(self.processors)),
            **{f"{name}_pct": _pct(getattr(self, name)) for name in names},
            "throttled_ms": None if self.throttled_ns is None else self.throttled_ns / NS_PER_MS,
            "quota_processors": self.quota_processors,
        }


def processor_shares(
    note: Mapping[str, Any], mates: Sequence[Mapping[str, Any] | None] = ()
) -> ProcessorShares | None:
    """Return the shares from a process's `ProcessorNote`; None for a note without a duration.

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

    def share(ns: float | None) -> float | None:
        return None if ns is None or not whole_ns else ns / whole_ns

    testbed_ns = None
    if known and None not in mates:
        theirs_ns = sum(mate["own_ns"] * _overlap(numbers_of(mate["processors"]), usable) for mate in mates if mate)
        testbed_ns = min(note["own_ns"] + theirs_ns, busy_ns)  # the kernel counts the two by different clocks
    n_periods = note["n_periods"]
    return ProcessorShares(
        wall_ns=wall_ns,
        processors=note["processors"],
        own=note["own_ns"] / wall_ns,
        testbed=share(testbed_ns),
        others=None if testbed_ns is None else share(busy_ns - testbed_ns),
        steal=share(steal_ns),
        idle=share(idle_ns),
        iowait=share(iowait_ns),
        quota_processors=note["quota_processors"],
        throttled=None if n_periods is None else note["n_throttled"] / max(1, n_periods),
        throttled_ns=note["throttled_ns"],
    )


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


def _pct(share: float | None) -> float | None:
    return None if share is None else 100 * share
