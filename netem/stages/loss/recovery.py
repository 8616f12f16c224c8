"""Recovery of lost packets on one connection, as TCP's sender makes it: repeats, and what waits behind them.

Linux's rules: RACK and the tail loss probe (RFC 8985), three later acknowledgements (RFC 5681), and the
retransmission timeout with its doubling (RFC 6298). What the congestion window (`tis.netem.stages.loss.congestion`)
does not let through is bundled into full segments. Delay and loss of acknowledgements are left out.
"""

from collections import deque
from collections.abc import Callable
from heapq import heappop, heappush
from typing import Any, Final, NamedTuple

from msgspec import Struct

from tis.common.units import NS_PER_MS
from tis.netem.stages.loss.congestion import OPEN, Congestion, Window

_MAX_ACK_DELAY_NS: Final = 200 * NS_PER_MS
_PROBE_SLACK_NS: Final = 8 * NS_PER_MS  # two ticks of Linux at 250 Hz
_N_DUPLICATES: Final = 3
_REORDERING_SHARE: Final = 4  # RACK waits a quarter of a round trip for packets that were overtaken
_SEGMENT_BYTES: Final = 1448
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
    congestion: Congestion


class Arrived(NamedTuple):
    """A packet that waits no longer, the instant at which it was given to the sender, and the one when it is due."""

    item: Any
    from_ns: int
    due_ns: int


class _Message(Struct, eq=False):
    """A packet given to the sender; ``due_ns`` is None until the segment with its end gets through."""

    item: Any
    delay_ns: int
    n_unsent: int
    is_lost: bool
    from_ns: int
    is_held_up: bool = False
    due_ns: int | None = None


class _Segment(Struct, eq=False):
    """Bytes that are sent together, and the messages that end in them; the first of these decides about a loss."""

    number: int
    messages: list[_Message]
    n_packets: int
    delay_ns: int
    terms: Terms
    sent_ns: int = 0
    n_sent: int = 0
    is_overtaken: bool = False
    is_marked: bool = False
    is_acked: bool = False


class Connection:
    """One connection: packets that are lost are sent again, and those behind them wait.

    A driver calls `advance` before `send`, and at `next_ns`; instants must not decrease. Without a loss, and within
    the congestion window, every packet is due after its own delay. Oracle: a simulation of a TCP sender by another
    method, and the TCP of a kernel, tests/netem/stages/loss/test_recovery.
    """

    def __init__(self, again: Again) -> None:
        self._again: Final = again
        self._n = 0
        self._window: Window | None = None
        self._terms: Terms | None = None
        self._waiting: deque[_Message] = deque()
        self._unsent: deque[_Message] = deque()
        self._unacked: deque[_Segment] = deque()
        self._missing: dict[int, _Segment] = {}  # lost, by number in order
        self._lost: list[tuple[int, _Segment]] = []  # those that the sender knows of and has not repeated
        self._acks: list[tuple[int, int, int, _Segment]] = []  # (arrival, number, sent_ns, segment)
        self._pipe = 0  # packets under way, as the sender knows
        self._n_out = 0  # packets of `_unacked`
        self._n_sacked = 0  # those of them that have arrived behind a gap
        self._backoff = 0
        self._advanced_ns = 0
        self._last_ns = 0
        self._probe = 0
        self._reordering_ns: int | None = None
        self._recovers_upto = 0  # 0: no recovery is under way
        self._barrier_ns = 0

    def send(
        self, item: Any, now_ns: int, delay_ns: int, n_bytes: int, is_lost: bool, terms: Terms
    ) -> int | None:  # fmt: skip
        """Send a packet; return the instant at which it is due, or None if it waits (then `advance` returns it)."""
        if self._window is None or self._window.kind != terms.congestion:
            self._window = Window(terms.congestion)
        self._terms = terms
        message = _Message(item, delay_ns, max(n_bytes, 1), is_lost, now_ns)
        self._unsent.append(message)
        self._fill(now_ns)
        if message.due_ns is not None and not self._waiting:
            return max(message.due_ns, self._barrier_ns)
        message.is_held_up = message.due_ns is None
        self._waiting.append(message)
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
                self._found_lost(next_ns, self._detect(next_ns))
            else:
                self._timed_out(next_ns)
        arrived: list[Arrived] = []
        while self._waiting and (due_ns := self._waiting[0].due_ns) is not None:
            message = self._waiting.popleft()
            due_ns = max(due_ns, self._barrier_ns)
            if message.is_held_up:
                self._barrier_ns = due_ns
            arrived.append(Arrived(message.item, message.from_ns, due_ns))
        while not self._waiting and self._acks and self._acks[0][0] <= now_ns:
            self._acknowledged(*heappop(self._acks))
        return arrived

    def _fill(self, at_ns: int, least: int = 0) -> None:
        """Send what the window lets through, or at least ``least`` packets: what is lost first."""
        window = self._window
        assert window is not None, "something was sent"
        n_before = self._pipe
        while (self._lost or self._unsent) and (self._pipe < window.size or self._pipe - n_before < least):
            if self._lost:
                self._transmit(heappop(self._lost)[1], at_ns)
            else:
                self._transmit(self._cut(max(1, window.size - self._pipe)), at_ns)
        if window.size < OPEN and (self._pipe > n_before or self._pipe >= window.size) and self._unacked:
            window.used(self._pipe, self._n_out, self._unacked[0].number, self._n)

    def _cut(self, most: int) -> _Segment:
        """Take the next segment from what is not sent; of a long message at most ``most`` packets."""
        first = self._unsent[0]
        n_packets = min(most, -(-first.n_unsent // _SEGMENT_BYTES))
        room, messages, delay_ns = n_packets * _SEGMENT_BYTES, [], 0
        while self._unsent and room > 0:
            message = self._unsent[0]
            taken = min(room, message.n_unsent)
            room, message.n_unsent, delay_ns = room - taken, message.n_unsent - taken, max(delay_ns, message.delay_ns)
            if not message.n_unsent:
                messages.append(self._unsent.popleft())
        self._n += 1
        assert self._terms is not None, "something was sent"
        segment = _Segment(self._n, messages, n_packets, delay_ns, self._terms)
        self._unacked.append(segment)
        self._n_out += n_packets
        return segment

    def _transmit(self, segment: _Segment, at_ns: int) -> None:
        assert self._window is not None, "something was sent"
        leaves_ns: int | None = at_ns
        if segment.messages:
            decides = segment.messages[0]
            if segment.n_sent:
                leaves_ns = self._again(decides.item, segment.n_sent, at_ns)
            elif decides.is_lost:
                leaves_ns = None
        segment.n_sent += 1
        segment.sent_ns = self._last_ns = at_ns
        segment.is_overtaken = segment.is_marked = False
        self._pipe += segment.n_packets
        self._window.left(segment.n_packets)
        if leaves_ns is None:
            self._missing[segment.number] = segment
            return
        self._missing.pop(segment.number, None)
        for message in segment.messages:
            message.due_ns = leaves_ns + message.delay_ns
        ack_ns = leaves_ns + segment.delay_ns + segment.terms.back_ns
        heappush(self._acks, (ack_ns, segment.number, at_ns, segment))

    def _head(self) -> _Segment:
        return next(iter(self._missing.values()))

    def _timeout_ns(self) -> int:
        """Return when the tail loss probe is due, or else the retransmission timeout."""
        head = self._head()
        terms = head.terms
        since_ns = max(head.sent_ns, self._advanced_ns)
        timeout_ns = since_ns + min((terms.rtt_ns + terms.rto_ns) << self._backoff, terms.max_rto_ns)
        return min(timeout_ns, self._probe_ns(head)) if self._probes(head) else timeout_ns

    def _probes(self, head: _Segment) -> bool:
        """Tell whether a probe is to come: the last packet is missing, and no recovery is under way."""
        return head.terms.tail_probe and self._n in self._missing and not (self._probe or self._recovers_upto)

    def _probe_ns(self, head: _Segment) -> int:
        alone = head.number == self._n
        slack_ns = min(head.terms.rto_ns, _MAX_ACK_DELAY_NS) if alone else _PROBE_SLACK_NS
        return max(self._last_ns, self._advanced_ns) + 2 * head.terms.rtt_ns + slack_ns

    def _acknowledged(self, at_ns: int, number: int, sent_ns: int, segment: _Segment) -> None:
        """Take an acknowledgement of a segment that was sent at ``sent_ns``."""
        window = self._window
        assert window is not None, "something was sent"
        segment.is_acked = True
        self._pipe -= segment.n_packets
        self._n_sacked += segment.n_packets
        moved = self._unacked[0] is segment
        while self._unacked and self._unacked[0].is_acked:
            n_packets = self._unacked.popleft().n_packets
            self._n_out -= n_packets
            self._n_sacked -= n_packets
        first = self._unacked[0].number if self._unacked else self._n + 1
        if moved:
            self._advanced_ns, self._backoff = at_ns, 0
        if self._probe and first > self._probe and not self._recovers_upto:
            window.reduce()  # the probe has repaired a loss
            window.end()
        self._probe = 0
        if self._recovers_upto and first > self._recovers_upto:
            self._recovers_upto = 0
            window.end()
        for missing in self._missing.values():
            if (missing.sent_ns, missing.number) < (sent_ns, number):
                missing.is_overtaken = True
        self._found_lost(at_ns, self._detect(at_ns), segment.n_packets, moved)

    def _found_lost(self, at_ns: int, found: bool, n: int = 1, moved: bool = False) -> None:
        """Begin a recovery of what was ``found`` lost, and send what ``n`` packets delivered let through."""
        assert self._window is not None, "something was sent"
        assert self._terms is not None, "something was sent"
        if found and not self._recovers_upto:
            self._recovers_upto = self._n
            self._window.reduce()
        self._window.delivered(n, self._pipe, moved, found, at_ns, self._terms.rtt_ns)
        self._fill(at_ns)

    def _detect(self, at_ns: int) -> bool:
        """Mark the packets that count as lost: a later one has arrived, and they had time to be only late."""
        self._reordering_ns = None
        if not self._missing:
            return False
        patient = not (self._recovers_upto or self._n_sacked >= _N_DUPLICATES)
        found = False
        for segment in self._missing.values():
            if not segment.is_overtaken or segment.is_marked:
                continue
            reordering_ns = segment.terms.rtt_ns // _REORDERING_SHARE if patient else 0
            due_ns = segment.sent_ns + segment.terms.rtt_ns + reordering_ns
            if patient and due_ns > at_ns:
                if self._reordering_ns is None or due_ns < self._reordering_ns:
                    self._reordering_ns = due_ns
            else:
                self._mark(segment)
                found = True
        return found

    def _mark(self, segment: _Segment) -> None:
        segment.is_marked = True
        self._pipe -= segment.n_packets
        heappush(self._lost, (segment.number, segment))

    def _timed_out(self, at_ns: int) -> None:
        """Send a probe; after the full timeout the first missing packet, whose acknowledgement frees others."""
        head = self._head()
        if self._probes(head) and self._probe_ns(head) == at_ns:
            if not self._unsent:
                self._mark(self._missing[self._n])
            self._fill(at_ns, least=1)
            self._probe = self._n
            return
        assert self._window is not None, "something was sent"
        self._backoff = min(self._backoff + 1, _MAX_BACKOFF)
        for segment in self._missing.values():
            if not segment.is_marked and (segment is head or segment.sent_ns + segment.terms.rtt_ns <= at_ns):
                self._mark(segment)
        self._window.timed_out(self._pipe, is_new=not self._recovers_upto)
        self._recovers_upto = self._n
        self._fill(at_ns)


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
