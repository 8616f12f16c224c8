"""A link, one direction of the network: packets are offered, held as long as the models say, and released."""

from collections import deque
from collections.abc import Iterable, Mapping
from heapq import heappop, heappush
from typing import Any, Final, NamedTuple

from common.address import Address
from common.channels import Direction
from common.header import Header
from common.records import Departure, Outcome
from common.scenario.network import Buffer
from common.scenario.network.capacity import Rate
from common.scenario.network.conditions import Change, TimelineEntry
from common.scenario.network.pipeline import Ordering as OrderingName
from common.trace import Trace
from netem.column import Errand
from netem.conditions import Condition, Conditions
from netem.disorder import Ordering, build_ordering
from netem.impairment import Impairment
from netem.queue.server import Server
from netem.rules import LINK, RuleTable

DROPS: Final = (
    "loss", "outage", "refused", "overflow", "queue_full", "late", "codel", "evicted",
)  # fmt: skip
MARKS: Final = frozenset(("query", "reply", "end", "token"))
MAX_FLOWS: Final = 20_000
_BYTES_PER_MB: Final = 1_000_000


class Fate(NamedTuple):
    """What was decided for one packet when it was offered.

    ``release_ns`` is 0 where nothing is delivered, and where the queue of a rate has still to say.
    """

    seq: int
    outcome: Outcome
    delay_ns: int = 0
    release_ns: int = 0
    n_copies: int = 0
    n_flips: int = 0
    foreign: bool = False


class Due(NamedTuple):
    """A packet that leaves, or is dropped after all; ``item`` is what was offered."""

    item: Any
    name: str
    seq: int
    copy_index: int
    offered_ns: int
    release_ns: int
    queued_ns: int
    departure: Departure
    n_flips: int
    foreign: bool


class _Flow:
    """One name's state; ``impairment`` None: it is refused."""

    __slots__ = ("changes", "group", "impairment", "n_unnumbered", "name", "ordering", "orderings")

    def __init__(self, name: str, impairment: Impairment | None, group: str) -> None:
        self.name = name
        self.impairment = impairment
        self.group = group
        self.n_unnumbered = 0
        self.changes: tuple[Change, ...] = ()
        self.orderings: dict[OrderingName, Ordering] = {}
        self.ordering = self.ordered("reorder" if impairment is None else impairment.ordering)

    def ordered(self, name: OrderingName) -> Ordering:
        """Return the ordering of that name, with what it remembers of this flow."""
        return self.orderings.setdefault(name, build_ordering(name))


class _Held:
    """A packet, or its copy, that waits for the queue of a rate or for its release."""

    __slots__ = ("copy_index", "delay_ns", "flow", "foreign", "gone", "item", "n_bytes", "n_flips", "offered_ns",
                 "ordering", "queued_ns", "release_ns", "seq")  # fmt: skip

    def __init__(
        self, flow: _Flow, item: Any, seq: int, copy_index: int, offered_ns: int, delay_ns: int, n_bytes: int,
        n_flips: int, foreign: bool,
    ) -> None:  # fmt: skip
        self.flow = flow
        self.ordering = flow.ordering
        self.item = item
        self.seq = seq
        self.copy_index = copy_index
        self.offered_ns = offered_ns
        self.delay_ns = delay_ns
        self.n_bytes = n_bytes
        self.n_flips = n_flips
        self.foreign = foreign
        self.queued_ns = 0
        self.release_ns = 0
        self.gone = False

    def due(self, departure: Departure) -> Due:
        return Due(
            self.item, self.flow.name, self.seq, self.copy_index, self.offered_ns, self.release_ns, self.queued_ns,
            departure, self.n_flips, self.foreign,
        )  # fmt: skip


class Link:
    """One direction. Always ``offered + copied == released + dropped + held`` (tests/netem/test_link, by hypothesis).

    A packet belongs to a flow by its name: the key of a message, or a key with a mark before it for what is no
    message (`flow_key`). ``buffer`` bounds the memory.
    """

    def __init__(
        self,
        direction: Direction,
        rules: RuleTable,
        seed: int,
        conditions: Conditions,
        traces: Mapping[str, Trace] | None = None,
        buffer: Buffer | None = None,
    ) -> None:
        self.direction: Final = direction
        self.conditions: Final = conditions
        self.rules = rules
        self.errands: list[Errand] = []
        self.offered = 0
        self.copied = 0
        self.flipped = 0
        self.released = 0
        self.dropped: dict[str, int] = dict.fromkeys(DROPS, 0)
        self.held = 0
        self.held_bytes = 0
        self.most_held = 0
        self._seed = seed
        self._traces = traces or {}
        buffer = buffer or Buffer()
        self._max_held = buffer.max_packets
        self._max_bytes = round(buffer.max_mb * _BYTES_PER_MB)
        self._evicts = buffer.policy == "drop_oldest"
        self._by_age: deque[_Held] = deque()
        self._evicted: list[Due] = []
        self._flows: dict[str, _Flow] = {}
        self._servers: dict[str, Server] = {}
        self._condition = conditions.at(0)
        # (release_ns, number, packet): the number breaks ties, so packets are never compared
        self._heap: list[tuple[int, int, _Held]] = []
        self._n_pushed = 0

    def prepare(self, names: Iterable[str]) -> None:
        """Open the flows of names that are expected and make their first draws, so that no packet waits for that."""
        for name in names:
            flow = self._flows.get(name) or self._open(name)
            if flow.impairment is not None:
                flow.impairment.decide(0, 0, 0, self._condition)
        self.run_errands()

    def run_errands(self, most: int | None = None) -> None:
        """Draw blocks that will soon be wanted; done when there is nothing else to do."""
        while self.errands and most != 0:
            self.errands.pop()()
            most = None if most is None else most - 1

    def address(self, name: str) -> Address:
        """Return where the random numbers of a flow belong."""
        return Address(self._seed, self.direction, name)

    def condition(self, now_ns: int) -> Condition:
        """Return the condition that holds at ``now_ns``, for this and the next packets."""
        self._condition = self.conditions.at(now_ns)
        return self._condition

    def change(self, entries: Iterable[TimelineEntry], now_ns: int) -> int:
        """Let changes hold on top of everything else, all from one instant on, which is returned."""
        from_ns = max([self.conditions.add(entry, now_ns) for entry in entries], default=now_ns)
        self.condition(now_ns)
        return from_ns

    def clear_changes(self, now_ns: int) -> int:
        """End every change that was made while running; return the instant from which that holds."""
        from_ns = self.conditions.clear_added(now_ns)
        self.condition(now_ns)
        return from_ns

    def offer(self, name: str, attachment: bytes, n_bytes: int, now_ns: int, item: Any) -> Fate:
        """Decide the fate of a packet and, when it is to leave, hold it; its delay counts from ``now_ns``.

        The sequence number is the header's when the attachment is ours, else a count of such packets by name.
        """
        self.offered += 1
        flow = self._flows.get(name) or self._open(name)
        header = Header.unpack(attachment)
        if header is None:
            seq, foreign = flow.n_unnumbered, True
            flow.n_unnumbered = seq + 1
        else:
            seq, foreign = header.seq, False
        impairment = flow.impairment
        if impairment is None:
            return self._drop(seq, "refused", foreign)
        condition = self._condition
        if now_ns >= condition.until_ns:
            condition = self.condition(now_ns)
        size = n_bytes + len(attachment)
        draw = impairment.decide(seq, now_ns, n_bytes, condition)
        if isinstance(draw, str):
            return self._drop(seq, draw, foreign)
        if condition.changes is not flow.changes:
            flow.changes = condition.changes
            flow.ordering = flow.ordered(impairment.ordering)
        if not self._has_room(size, now_ns):
            return self._drop(seq, "overflow", foreign)
        held = _Held(flow, item, seq, 0, now_ns, draw.delay_ns, size, draw.n_flips, foreign)
        rate, group = impairment.rate, flow.group
        if isinstance(rate, str):
            own = self.rules.default.rate
            rate, group = None if isinstance(own, str) else own, LINK
        if rate is None:
            release_ns = self._hold(held, now_ns)
        elif self._queue(held, rate, group, now_ns):
            release_ns = 0
        else:
            return self._drop(seq, "queue_full", foreign)
        self.flipped += draw.n_flips
        n_copies = 0
        if draw.copy_delay_ns >= 0 and self._has_room(size, now_ns):
            copy = _Held(flow, item, seq, 1, now_ns, draw.copy_delay_ns, size, draw.n_flips, foreign)
            if rate is None:
                self._hold(copy, now_ns)
                n_copies = 1
            else:
                n_copies = int(self._queue(copy, rate, group, now_ns))
            self.copied += n_copies
        return Fate(seq, "deliver", draw.delay_ns, release_ns, n_copies, draw.n_flips, foreign)

    def next_release_ns(self) -> int | None:
        """Return the instant at which something is to be done next; None while nothing is held."""
        if self._evicted:
            return self._evicted[0].offered_ns
        next_ns = self._heap[0][0] if self._heap else None
        for server in self._servers.values():
            departure_ns = server.next_departure_ns()
            if departure_ns is not None and (next_ns is None or departure_ns < next_ns):
                next_ns = departure_ns
        return next_ns

    def release(self, now_ns: int) -> list[Due]:
        """Return the packets due at ``now_ns``, by release instant, equal ones in the order of offering.

        Those that are dropped after all are returned too, so that they can be logged.
        """
        due, self._evicted = self._evicted, []
        for server in self._servers.values():
            for departed in server.depart(now_ns):
                held: _Held = departed.item
                held.queued_ns = departed.left_ns - held.offered_ns
                if held.gone:
                    continue
                if departed.dropped:
                    due.append(self._lose(held, "codel"))
                else:
                    self._push(held, departed.left_ns)
        heap = self._heap
        while heap and heap[0][0] <= now_ns:
            held = heappop(heap)[2]
            if held.gone:
                continue
            if held.ordering.passes(held.seq):
                held.gone = True
                self.held -= 1
                self.held_bytes -= held.n_bytes
                self.released += 1
                due.append(held.due("released"))
            else:
                due.append(self._lose(held, "late"))
        return due

    def queue_depth(self) -> tuple[int, int]:
        """Return the packets and bytes that wait in the queues of rates."""
        servers = self._servers.values()
        return sum(server.n_packets for server in servers), sum(server.n_bytes for server in servers)

    @property
    def traces(self) -> Mapping[str, Trace]:
        """Return the recorded networks that a pipeline may name, by their path."""
        return self._traces

    @property
    def has_queues(self) -> bool:
        """Tell whether any rate has been asked for so far."""
        return bool(self._servers)

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name; ``held_at_end`` is what is held now."""
        counts = {"offered": self.offered, "copied": self.copied, "released": self.released}
        counts |= {f"dropped.{cause}": count for cause, count in self.dropped.items()}
        counts |= {"held_at_end": self.held, "most_held": self.most_held, "flipped_bits": self.flipped}
        return {f"{self.direction}.{name}": count for name, count in counts.items()}

    def _open(self, name: str) -> _Flow:
        assigned = self.rules.assign(flow_key(name)) if len(self._flows) < MAX_FLOWS else None
        if assigned is None:
            flow = _Flow(name, None, "")
            if len(self._flows) >= MAX_FLOWS:
                return flow
        else:
            impairment = Impairment(assigned.pipeline, self.address(name), self._traces, self.errands)
            flow = _Flow(name, impairment, assigned.group)
        self._flows[name] = flow
        return flow

    def _has_room(self, n_bytes: int, now_ns: int) -> bool:
        if self.held < self._max_held and self.held_bytes + n_bytes <= self._max_bytes:
            return True
        if not self._evicts:
            return False
        while self._by_age and (self.held >= self._max_held or self.held_bytes + n_bytes > self._max_bytes):
            oldest = self._by_age.popleft()
            if not oldest.gone:
                self._evicted.append(self._lose(oldest, "evicted")._replace(release_ns=now_ns))
        return self.held < self._max_held and self.held_bytes + n_bytes <= self._max_bytes

    def _queue(self, held: _Held, rate: Rate, group: str, now_ns: int) -> bool:
        """Let a packet wait for its transmission; False: the queue is full."""
        server = self._servers.get(group)
        if server is None:
            server = self._servers[group] = Server.of(rate)
        elif server.rate is not rate:
            server.set_rate(rate, now_ns)
        if not server.offer(held, held.n_bytes, now_ns):
            return False
        self._count_in(held)
        return True

    def _hold(self, held: _Held, now_ns: int) -> int:
        self._count_in(held)
        return self._push(held, now_ns)

    def _count_in(self, held: _Held) -> None:
        self.held += 1
        self.held_bytes += held.n_bytes
        if self.held > self.most_held:
            self.most_held = self.held
        if self._evicts:
            self._by_age.append(held)

    def _push(self, held: _Held, from_ns: int) -> int:
        release_ns = held.ordering.schedule(from_ns + held.delay_ns)
        held.release_ns = release_ns
        self._n_pushed += 1
        heappush(self._heap, (release_ns, self._n_pushed, held))
        return release_ns

    def _lose(self, held: _Held, departure: Departure) -> Due:
        held.gone = True
        self.held -= 1
        self.held_bytes -= held.n_bytes
        self.dropped[departure] += 1
        return held.due(departure)

    def _drop(self, seq: int, outcome: Outcome, foreign: bool) -> Fate:
        self.dropped[outcome] += 1
        return Fate(seq, outcome, foreign=foreign)


def flow_key(name: str) -> str:
    """Return the key of a flow's name: queries, replies and tokens have a mark and a space before it."""
    mark, _, key = name.partition(" ")
    return key if mark in MARKS else name
