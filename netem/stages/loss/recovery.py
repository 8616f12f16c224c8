"""Recovery of lost packets on one connection, as TCP's sender makes it: repeats, and what waits behind them.

Linux's rules: RACK and the tail loss probe (RFC 8985), three later acknowledgements (RFC 5681), and the
retransmission timeout with its doubling (RFC 6298), after which packets leave as acknowledgements come (slow start).
Congestion control and the loss of acknowledgements are left out.
"""

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any, Final, NamedTuple

from msgspec import Struct

from tis.common.units import NS_PER_MS

_MAX_ACK_DELAY_NS: Final = 200 * NS_PER_MS
_PROBE_SLACK_NS: Final = 8 * NS_PER_MS  # two ticks of Linux at 250 Hz
_N_DUPLICATES: Final = 3
_REORDERING_SHARE: Final = 4  # RACK waits a quarter of a round trip for packets that were overtaken
_SEGMENT_BYTES: Final = 1448
_SEGMENTS_PER_ACK: Final = 2
_MAX_BACKOFF: Final = 30

Again = Callable[[Any, int, int], int | None]
"""When repeat ``n`` >= 1 of an item, sent at an instant, really leaves; None if it is lost as well."""


class Terms(NamedTuple):
    """The connection's figures: round trip and its way back, timeout above a round trip, longest timeout."""

    rtt_ns: int
    back_ns: int
    rto_ns: int
    max_rto_ns: int
    tail_probe: bool


class Arrived(NamedTuple):
    """A packet that waits no longer, the instant at which it was given to the sender, and the one when it is due."""

    item: Any
    from_ns: int
    due_ns: int


class _Sent(Struct, eq=False):
    """A packet of the connection; ``due_ns`` is None until a sending gets through."""

    item: Any
    number: int
    delay_ns: int
    n_bytes: int
    is_lost: bool
    terms: Terms
    from_ns: int
    sent_ns: int = 0
    n_sent: int = 0
    n_after: int = 0
    is_held_up: bool = False
    due_ns: int | None = None


class Connection:
    """One connection: packets that are lost are sent again, and those behind them wait.

    A driver calls `advance` before `send`, and at `next_ns`; instants must not decrease. Without a loss every packet
    is due after its own delay. Oracle: a simulation of a TCP sender by another method, and the TCP of a kernel,
    tests/netem/stages/loss/test_recovery.
    """

    def __init__(self, again: Again) -> None:
        self._again: Final = again
        self._n = 0
        self._waiting: deque[_Sent] = deque()
        self._missing: dict[int, _Sent] = {}  # lost, and the sender does not know or has repeated it in vain
        self._unsent: deque[_Sent] = deque()  # since a timeout: they leave as acknowledgements come
        self._acks: list[tuple[int, int, int]] = []  # (arrival, number, sent_ns)
        self._is_blocked = False
        self._backoff = 0
        self._advanced_ns = 0
        self._last_ns = 0
        self._is_probed = False
        self._reordering_ns: int | None = None
        self._recovers_upto = 0
        self._recovers_until_ns = -1
        self._barrier_ns = 0

    def send(
        self, item: Any, now_ns: int, delay_ns: int, n_bytes: int, is_lost: bool, terms: Terms
    ) -> int | None:  # fmt: skip
        """Send a packet; return the instant at which it is due, or None if it waits (then `advance` returns it)."""
        self._n += 1
        packet = _Sent(item, self._n, delay_ns, n_bytes, is_lost, terms, now_ns)
        if self._is_blocked:
            packet.is_held_up = True
            self._unsent.append(packet)
        else:
            self._transmit(packet, now_ns)
            if packet.due_ns is not None and not self._waiting:
                return max(packet.due_ns, self._barrier_ns)
        self._waiting.append(packet)
        return None

    def next_ns(self) -> int | None:
        """Return the instant of the next event; None while nothing waits."""
        if not self._waiting:
            return None
        instants = [self._acks[0][0]] if self._acks else []
        if self._reordering_ns is not None:
            instants.append(self._reordering_ns)
        if self._missing:
            instants.append(self._timeout_ns())
        return min(instants, default=None)

    def advance(self, now_ns: int) -> list[Arrived]:
        """Let all happen that happens until ``now_ns``; return the packets that wait no longer, in order."""
        while (next_ns := self.next_ns()) is not None and next_ns <= now_ns:
            if self._acks and self._acks[0][0] == next_ns:
                self._acknowledged(*heappop(self._acks))
            elif self._reordering_ns == next_ns:
                self._detect(next_ns)
            else:
                self._timed_out(next_ns)
        while not self._waiting and self._acks and self._acks[0][0] <= now_ns:
            self._advanced_ns = heappop(self._acks)[0]
            self._backoff, self._is_blocked, self._is_probed = 0, False, False
        arrived: list[Arrived] = []
        while self._waiting and (due_ns := self._waiting[0].due_ns) is not None:
            packet = self._waiting.popleft()
            due_ns = max(due_ns, self._barrier_ns)
            if packet.n_sent > 1 or packet.is_held_up:
                self._barrier_ns = due_ns
            arrived.append(Arrived(packet.item, packet.from_ns, due_ns))
        return arrived

    def _transmit(self, packet: _Sent, at_ns: int) -> None:
        if packet.n_sent:
            leaves_ns = self._again(packet.item, packet.n_sent, at_ns)
        else:
            leaves_ns = None if packet.is_lost else at_ns
        packet.n_sent += 1
        packet.sent_ns = self._last_ns = at_ns
        packet.n_after = 0
        if leaves_ns is None:
            self._missing[packet.number] = packet
            return
        self._missing.pop(packet.number, None)
        packet.due_ns = leaves_ns + packet.delay_ns
        ack_ns = packet.due_ns + packet.terms.back_ns
        heappush(self._acks, (ack_ns, packet.number, at_ns))
        if packet.n_sent > 1 and ack_ns > self._recovers_until_ns:
            self._recovers_until_ns = ack_ns

    def _head(self) -> _Sent:
        return next(iter(self._missing.values()))

    def _timeout_ns(self) -> int:
        """Return when the tail loss probe is due, or else the retransmission timeout."""
        head = self._head()
        terms = head.terms
        since_ns = max(head.sent_ns, self._advanced_ns)
        timeout_ns = since_ns + min((terms.rtt_ns + terms.rto_ns) << self._backoff, terms.max_rto_ns)
        return min(timeout_ns, self._probe_ns(head)) if self._probes(head) else timeout_ns

    def _probes(self, head: _Sent) -> bool:
        """Tell whether a probe is to come: the last packet is missing, and no recovery is under way."""
        return (
            head.terms.tail_probe
            and self._n in self._missing
            and not (self._is_probed or self._is_blocked or self._recovers(self._last_ns))
        )

    def _probe_ns(self, head: _Sent) -> int:
        alone = head.number == self._n
        slack_ns = min(head.terms.rto_ns, _MAX_ACK_DELAY_NS) if alone else _PROBE_SLACK_NS
        return max(self._last_ns, self._advanced_ns) + 2 * head.terms.rtt_ns + slack_ns

    def _recovers(self, at_ns: int) -> bool:
        missing = next(iter(self._missing), None)
        return at_ns <= self._recovers_until_ns or (missing is not None and missing <= self._recovers_upto)

    def _acknowledged(self, at_ns: int, number: int, sent_ns: int) -> None:
        """Take an acknowledgement of a packet that was sent at ``sent_ns``."""
        first = min(next(iter(self._missing), self._n + 1), self._unsent[0].number if self._unsent else self._n + 1)
        if number < first:
            self._advanced_ns, self._backoff = at_ns, 0
        self._is_probed = False
        for packet in self._missing.values():
            if (packet.sent_ns, packet.number) < (sent_ns, number):
                packet.n_after += 1
        self._detect(at_ns)
        budget = _SEGMENTS_PER_ACK * _SEGMENT_BYTES
        while self._unsent and budget > 0:
            packet = self._unsent.popleft()
            budget -= packet.n_bytes
            self._transmit(packet, at_ns)
        self._is_blocked = self._is_blocked and bool(self._unsent)

    def _detect(self, at_ns: int) -> None:
        """Repeat the packets that count as lost: a later one has arrived, and they had time to be only late."""
        self._reordering_ns = None
        if not self._missing:
            return
        head = self._head()
        patient = not (self._recovers(at_ns) or head.n_after >= _N_DUPLICATES)
        for packet in list(self._missing.values()):
            if not packet.n_after:
                continue
            reordering_ns = packet.terms.rtt_ns // _REORDERING_SHARE if patient else 0
            due_ns = packet.sent_ns + packet.terms.rtt_ns + reordering_ns
            if patient and due_ns > at_ns:
                if self._reordering_ns is None or due_ns < self._reordering_ns:
                    self._reordering_ns = due_ns
            else:
                self._recovers_upto = max(self._recovers_upto, self._n)
                self._transmit(packet, at_ns)

    def _timed_out(self, at_ns: int) -> None:
        """Repeat the last packet as a probe; after the full timeout the first, whose acknowledgement frees others."""
        head = self._head()
        if self._probes(head) and self._probe_ns(head) == at_ns:
            self._is_probed = True
            self._transmit(self._missing[self._n], at_ns)
            return
        self._backoff = min(self._backoff + 1, _MAX_BACKOFF)
        self._is_blocked = True
        del self._missing[head.number]
        self._unsent.extendleft(reversed(self._missing.values()))
        self._missing.clear()
        self._recovers_upto = self._n
        self._transmit(head, at_ns)


class Connections:
    """The connections of a link: one for all flows, or ``each`` flow's own.

    A driver calls `advance` at `next_ns`, and before anything else happens.
    """

    def __init__(self, again: Again, each: bool = False) -> None:
        self.by_name: Final[dict[str, Connection]] = {}
        """Those that have sent something; empty as long as nothing needs a recovery."""
        self._again: Final = again
        self._each: Final = each

    def next_ns(self) -> int | None:
        """Return the instant of the next event; None while nothing waits."""
        instants = [ns for one in self.by_name.values() if (ns := one.next_ns()) is not None]
        return min(instants, default=None)

    def advance(self, now_ns: int) -> list[Arrived]:
        """Let all happen that happens until ``now_ns``; return the packets that wait no longer, in order."""
        return [arrived for one in self.by_name.values() for arrived in one.advance(now_ns)]

    def of(self, flow: str) -> Connection:
        """Return the connection of a flow."""
        name = flow if self._each else ""
        found = self.by_name.get(name)
        if found is None:
            found = self.by_name[name] = Connection(self._again)
        return found
