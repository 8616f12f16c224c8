"""Instants of a run at a rate: the ticks, and the send plan of all packets, with several copies of each sample.

Tick k is due at ``k * 10**9 // rate_hz + phase_ns``, independently of earlier lateness. The sequence numbers of the
plan count the planned packets of a key in the order of their due instants, in which they are sent. Receivers and
`drop_late` therefore see increasing numbers, and a packet that is not sent leaves a gap without shifting the others'
numbers, which address their fates in netem.
"""

from dataclasses import dataclass, field
from heapq import heappop, heapreplace
from typing import NamedTuple

from tis.common.units import NS_PER_S, sample_instant_ns


@dataclass
class Ticker:
    """Ticks 0..n_ticks-1, with a count of the missed ones (not begun before the next one is due)."""

    rate_hz: int
    n_ticks: int
    phase_ns: int = 0
    k: int = 0
    n_missed: int = 0

    def due_ns(self, k: int) -> int:
        """Return the nominal instant of tick ``k`` in run time."""
        return sample_instant_ns(k, self.rate_hz) + self.phase_ns

    def next_due_ns(self) -> int | None:
        """Return when the next tick is due; None after the last."""
        return self.due_ns(self.k) if self.k < self.n_ticks else None

    def start_at(self, from_ns: int) -> None:
        """Begin with the first tick that is due at ``from_ns`` or later (oracle: a linear scan in the tests)."""
        # floor(k * 10^9 / rate) is at least an integer x exactly where k is at least x * rate / 10^9
        self.k = min(max(0, -(-(from_ns - self.phase_ns) * self.rate_hz // NS_PER_S)), self.n_ticks)

    def skip_missed(self, now_ns: int) -> range:
        """Skip and count the ticks that can no longer begin in time; return their numbers.

        Afterwards ``k`` is the tick in whose period ``now_ns`` falls (oracle: a linear scan in the tests).
        """
        # A tick is missed when the next one is due already, so it may begin late by less than a period.
        first = self.k
        while self.k < self.n_ticks and now_ns >= self.due_ns(self.k + 1):
            self.k += 1
        self.n_missed += self.k - first
        return range(first, self.k)

    def begin(self) -> int:
        """Begin the current tick: return its number and advance to the next."""
        self.k += 1
        return self.k - 1


class PlannedPacket(NamedTuple):
    """Copy ``copy`` (0: the first) of sample ``k``; ``seq`` is its sequence number on each of the surgeon's keys."""

    due_ns: int
    seq: int
    k: int
    copy: int


@dataclass
class SendPlan:
    """Copy c of sample k is due ``c * spacing_ns`` after its sample instant; at equal instants fresh samples first.

    Oracle: all instants sorted, tests/common/test_ticker.
    """

    rate_hz: int
    n_samples: int
    copies: int = 1
    spacing_ns: int = 0
    _seq: int = 0
    _heads: list[tuple[int, int, int]] = field(init=False, repr=False)  # of each copy: (due_ns, copy, next k)

    def __post_init__(self) -> None:
        copies = range(self.copies if self.n_samples > 0 else 0)
        self._heads = [(self.due_ns(0, copy), copy, 0) for copy in copies]

    def due_ns(self, k: int, copy: int) -> int:
        """Return the run time at which copy ``copy`` of sample ``k`` is due."""
        return sample_instant_ns(k, self.rate_hz) + copy * self.spacing_ns

    def seq_of(self, k: int, copy: int) -> int:
        """Return the sequence number of a planned packet without walking the plan."""
        due_ns = self.due_ns(k, copy)
        return sum(self._n_before(due_ns, other, or_at=other < copy) for other in range(self.copies))

    def _n_before(self, due_ns: int, copy: int, or_at: bool) -> int:
        """Return how many packets of a copy are due before an instant, or at it."""
        # sample k lies at floor(k * 10^9 / rate), which is below x exactly if k < x * rate / 10^9
        until_ns = due_ns - copy * self.spacing_ns + or_at
        return min(max(-(-until_ns * self.rate_hz // NS_PER_S), 0), self.n_samples)

    def next_due_ns(self) -> int | None:
        """Return the run time at which the next packet is due; None after the last."""
        return self._heads[0][0] if self._heads else None

    def pop(self) -> PlannedPacket:
        """Return the next packet and advance; there must be one."""
        # The heap holds the next sample of each copy: the earliest head is followed by the same copy of sample k + 1.
        due_ns, copy, k = self._heads[0]
        if k + 1 < self.n_samples:
            heapreplace(self._heads, (self.due_ns(k + 1, copy), copy, k + 1))
        else:
            heappop(self._heads)
        seq, self._seq = self._seq, self._seq + 1
        return PlannedPacket(due_ns, seq, k, copy)
