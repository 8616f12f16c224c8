"""The flows of a link by name: opened by a name's first packet, closed when idle, continued when the name returns.

What a flow draws is addressed by its name and sequence numbers, so a closed one is built again as it was. Of the
packets that it numbered itself their number is kept, in a table of fixed size.
"""

import hashlib
from typing import Final

import numpy as np

from tis.common.units import NS_PER_S
from tis.netem.link.packet import Flow

MAX_FLOWS: Final = 20_000
"""Beyond it, flows are closed as soon as nothing of them is held."""

MAX_CLOSED: Final = 400_000
"""The closed flows whose numbers are kept. Beyond it, new names are numbered from above all that were forgotten."""

_NEAR: Final = 0.8
IDLE_NS: Final = 20 * NS_PER_S
_LOOKS: Final = 4  # at the flows that were looked at longest ago, whenever a name is opened
_SLOTS: Final = 1 << 19


class Flows:
    """The open flows, the one looked at longest ago first, and the numbers of closed ones.

    A flow is closed when a look finds that nothing has changed for `IDLE_NS`. Looks happen only when another flow is
    opened, so a link with few names closes none, and no packet of an open flow pays for them.
    """

    def __init__(self) -> None:
        self.open: Final[dict[str, Flow]] = {}
        self.most_open = 0
        self._numbers: Final = _Numbers()

    def counters(self) -> dict[str, int]:
        """Return the counts that near their bound, by name: most flows open at once, flows closed."""
        counts = {"most_names": (self.most_open, MAX_FLOWS), "gone_names": (self.n_gone, MAX_CLOSED)}
        return {name: n for name, (n, most) in counts.items() if n >= _NEAR * most}

    def add(self, flow: Flow, now_ns: int) -> None:
        """Open a flow, numbered from where it was, and close idle ones.

        Oracle: a link without a bound, tests/netem/link/test_flows.
        """
        self._look(now_ns)
        if self._numbers.n or self._numbers.first:
            flow.n_unnumbered = self._numbers.of(flow.name)
        self._keep(flow, now_ns)
        self.most_open = max(self.most_open, len(self.open))

    def _look(self, now_ns: int) -> None:
        for _ in range(min(_LOOKS, len(self.open))):
            flow = next(iter(self.open.values()))
            is_full = len(self.open) >= MAX_FLOWS
            if not is_full and now_ns - flow.looked_ns < IDLE_NS:
                return  # and so it is with all others
            del self.open[flow.name]
            holds = flow.n_queued > 0 or flow.n_awaited > 0 or flow.latest_ns > now_ns
            if holds or (not is_full and flow.activity != flow.n_unnumbered + flow.latest_ns):
                self._keep(flow, now_ns)
            else:
                self._numbers.keep(flow.name, flow.n_unnumbered)

    @property
    def n_gone(self) -> int:
        """Return the number of names whose flow was closed once, as far as their numbers matter."""
        return self._numbers.n + self._numbers.n_forgotten

    def _keep(self, flow: Flow, now_ns: int) -> None:
        flow.looked_ns, flow.activity = now_ns, flow.n_unnumbered + flow.latest_ns
        self.open[flow.name] = flow


class _Numbers:
    """The next number of each closed flow: a hash table with linear probing, 16 bytes a slot.

    Names are kept as 64 bits of their digest. Two of `MAX_CLOSED` names share them with a probability of 4e-9; then
    the second goes on above the numbers of the first.
    """

    def __init__(self) -> None:
        self.n = 0
        self.n_forgotten = 0
        self.first = 0
        self._greatest = 0
        self._digests = self._numbers = memoryview(b"")

    def keep(self, name: str, number: int) -> None:
        """Keep the number of a flow that is closed."""
        if number <= self.first:
            return
        self._greatest = max(self._greatest, number)
        digest = _digest(name)
        slot = self._slot(digest) if self.n else 0
        if not self.n or (self._digests[slot] == 0 and self.n >= MAX_CLOSED):
            self._forget()
            slot = self._slot(digest)
        if self._digests[slot] == 0:
            self._digests[slot] = digest
            self.n += 1
        self._numbers[slot] = number

    def of(self, name: str) -> int:
        """Return the next number of a name."""
        return max(self.first, self._numbers[self._slot(_digest(name))]) if self.n else self.first

    def _forget(self) -> None:
        """Begin with an empty table, and with numbers that nobody has had."""
        self.first = self._greatest if self.n else self.first
        self.n_forgotten += self.n
        self.n = 0
        # zeros take memory only where something is written
        self._digests, self._numbers = (np.zeros(_SLOTS, np.uint64).data for _ in range(2))

    def _slot(self, digest: int) -> int:
        slot = digest % _SLOTS
        while self._digests[slot] not in (0, digest):
            slot = (slot + 1) % _SLOTS
        return slot


def _digest(name: str) -> int:
    """Return 64 bits of a name, never 0, the same in every process."""
    return int.from_bytes(hashlib.blake2b(name.encode(), digest_size=8).digest(), "little") or 1
