"""The send plan: the due instants and sequence numbers of all packets, with several copies of each sample.

The sequence numbers count the planned packets of a key in the order of their due instants, in which they are sent.
Receivers and `drop_late` therefore see increasing numbers, and a packet that is not sent leaves a gap without
shifting the others' numbers, which address their fates in netem.
"""

from dataclasses import dataclass, field
from heapq import heappop, heapreplace
from typing import NamedTuple

from tis.common.units import NS_PER_S, sample_instant_ns


class PlannedPacket(NamedTuple):
    """Copy ``copy`` (0: the first) of sample ``k``; ``seq`` is its sequence number on each of the surgeon's keys."""

    due_ns: int
    seq: int
    k: int
    copy: int


@dataclass
class SendPlan:
    """Copy c of sample k is due ``c * spacing_ns`` after its sample instant; at equal instants fresh samples first.

    Oracle: all instants sorted, tests/surgeon_side/test_send_plan.
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
