"""Packets seen on the network they come from and on the one they go to: how long they took, which are lost.

Both instants are the observer's own, so no clock has to agree with another one.
"""

from collections import OrderedDict
from typing import Final, NamedTuple, TypeVar

from common.units import NS_PER_S

T = TypeVar("T")

_MIN_TIMEOUT_NS: Final = NS_PER_S // 2
_MAX_TIMEOUT_NS: Final = 5 * NS_PER_S
_MARGIN_NS: Final = 3 * NS_PER_S // 10
_DECAY: Final = 0.998
_MAX_PENDING: Final = 50_000


class Crossing(NamedTuple):
    """A packet sent at ``sent_ns`` of run time: what it took, or None when it is taken for lost."""

    sent_ns: int
    delay_ns: int | None


class Crossings:
    """Pairs the packets of one stream by sequence number. Bounded: of too many under way the oldest are forgotten.

    A packet is taken for lost when it has been under way for 0.3 s more than twice the longest delay of late, half
    a second at least and five at most. One that arrives after all is told again, with its delay.
    """

    def __init__(self) -> None:
        self._offered: OrderedDict[int, tuple[int, int]] = OrderedDict()
        self._early: OrderedDict[int, int] = OrderedDict()
        self._expired: OrderedDict[int, tuple[int, int]] = OrderedDict()
        self._longest_ns = 0.0

    @property
    def loss_timeout_ns(self) -> int:
        """Return after what time a packet is taken for lost."""
        adaptive_ns = int(2 * self._longest_ns) + _MARGIN_NS
        return min(max(adaptive_ns, _MIN_TIMEOUT_NS), _MAX_TIMEOUT_NS)

    def offered(self, seq: int, sent_ns: int, at_ns: int) -> Crossing | None:
        """Take in a packet on the network it comes from; it may have been seen on the other one already."""
        arrived_ns = self._early.pop(seq, None)
        if arrived_ns is not None:
            return self._crossed(sent_ns, max(0, arrived_ns - at_ns))
        _put(self._offered, seq, (sent_ns, at_ns))
        return None

    def arrived(self, seq: int, at_ns: int) -> Crossing | None:
        """Take in a packet on the network it goes to; a copy, or one sent before anybody looked, tells nothing."""
        found = self._offered.pop(seq, None)
        if found is None:
            found = self._expired.pop(seq, None)
        if found is None:
            _put(self._early, seq, at_ns)
            return None
        sent_ns, offered_ns = found
        return self._crossed(sent_ns, max(0, at_ns - offered_ns))

    def expire(self, now_ns: int) -> list[Crossing]:
        """Return the packets that are now taken for lost, in the order of sending."""
        before_ns = now_ns - self.loss_timeout_ns
        lost = []
        while self._offered:
            seq, found = next(iter(self._offered.items()))
            if found[1] > before_ns:
                break
            del self._offered[seq]
            _put(self._expired, seq, found)
            lost.append(Crossing(found[0], None))
        while self._early and next(iter(self._early.values())) < now_ns - _MAX_TIMEOUT_NS:
            self._early.popitem(last=False)
        return lost

    def keep_multiples(self, n: int) -> None:
        """Forget the packets under way whose numbers are no multiples of ``n``: nobody will look for them."""
        for table in (self._offered, self._early, self._expired):
            for seq in [seq for seq in table if seq % n]:
                table.pop(seq)

    def _crossed(self, sent_ns: int, delay_ns: int) -> Crossing:
        self._longest_ns = max(self._longest_ns * _DECAY, delay_ns)
        return Crossing(sent_ns, delay_ns)


def _put(table: OrderedDict[int, T], seq: int, value: T) -> None:
    table[seq] = value
    if len(table) > _MAX_PENDING:
        table.popitem(last=False)
