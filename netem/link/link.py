"""A link, one direction of the network: packets are offered, held as long as the models say, and released."""

from collections import deque
from collections.abc import Iterable, Mapping
from heapq import heappop, heappush
from typing import Any, Final

from common.channels import Direction
from common.records import Departure, Outcome
from common.scenario.network import Buffer
from common.scenario.network.capacity import Rate
from common.scenario.network.conditions import TimelineEntry
from common.streams import Address
from common.trace import Trace
from netem.conditions.conditions import Condition, Conditions
from netem.draws.column import Errand
from netem.link.flow import Flow, flow_key
from netem.link.packet import Due, Fate, Held
from netem.link.queue.server import Server
from netem.link.rules import LINK, RuleTable
from netem.stages.impairment import Impairment

DROPS: Final = (
    "loss", "outage", "refused", "overflow", "queue_full", "late", "codel", "evicted",
)  # fmt: skip
MAX_FLOWS: Final = 20_000
_BYTES_PER_MB: Final = 1_000_000


class Link:
    """One direction: always ``offered + copied == released + dropped + held``.

    Oracle: conservation by hypothesis, tests/netem/link/test_link.

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
        self._by_age: deque[Held] = deque()
        self._evicted: list[Due] = []
        self._flows: dict[str, Flow] = {}
        self._servers: dict[str, Server] = {}
        self._clear_until_ns = 0
        self._condition = self.condition(0)
        # (release_ns, number, packet): the number breaks ties, so packets are never compared
        self._heap: list[tuple[int, int, Held]] = []
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
        condition = self._condition = self.conditions.at(now_ns)
        self._clear_until_ns = condition.until_ns if condition.is_clear else 0
        return condition

    def change(self, entries: Iterable[TimelineEntry], now_ns: int) -> int:
        """Let changes hold on top of everything else, all from one instant on, which is returned."""
        from_ns = max([self.conditions.add(entry, now_ns) for entry in entries], default=now_ns)
        self.condition(now_ns)
        return from_ns

    def offer(self, name: str, attachment: bytes, n_bytes: int, now_ns: int, item: Any) -> Fate:
        """Decide the fate of a packet and, when it is to leave, hold it; its delay counts from ``now_ns``.

        The sequence number is the header's when the attachment is ours, else a count of such packets by name.
        """
        self.offered += 1
        flow = self._flows.get(name) or self._open(name)
        seq, foreign = flow.number(attachment)
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
        held = Held(flow, item, seq, 0, now_ns, draw.delay_ns, size, draw.n_flips, foreign)
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
            copy = Held(flow, item, seq, 1, now_ns, draw.copy_delay_ns, size, draw.n_flips, foreign)
            if rate is None:
                self._hold(copy, now_ns)
                n_copies = 1
            else:
                n_copies = int(self._queue(copy, rate, group, now_ns))
            self.copied += n_copies
        return Fate(seq, "deliver", draw.delay_ns, release_ns, n_copies, draw.n_flips, foreign)

    def lets_through(self, name: str, n_bytes: int, now_ns: int) -> bool:
        """Tell whether nothing holds back a packet offered now: then it has crossed, and counts as released.

        That is where nothing is held, its pipeline has no stages and the conditions add none. It saves a packet the
        time that deciding takes where all is certain (oracle: `offer`, then `release`,
        tests/netem/link/test_crossing).
        """
        flow = self._flows.get(name)
        if flow is None or not flow.is_open or self.held or now_ns >= self._clear_until_ns or flow.changes:
            return False
        if self._servers or self._evicted or n_bytes > self._max_bytes or flow.ordering.schedule(now_ns) > now_ns:
            return False
        self.offered += 1
        self.released += 1
        self.most_held = self.most_held or 1
        return True

    def number(self, name: str, attachment: bytes) -> tuple[int, bool]:
        """Return the sequence number of a packet that was let through, and whether it is foreign."""
        return self._flows[name].number(attachment)

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
                held: Held = departed.item
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

    def _open(self, name: str) -> Flow:
        assigned = self.rules.assign(flow_key(name)) if len(self._flows) < MAX_FLOWS else None
        if assigned is None:
            flow = Flow(name, None, "")
            if len(self._flows) >= MAX_FLOWS:
                return flow
        else:
            impairment = Impairment(assigned.pipeline, self.address(name), self._traces, self.errands)
            flow = Flow(name, impairment, assigned.group)
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

    def _queue(self, held: Held, rate: Rate, group: str, now_ns: int) -> bool:
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

    def _hold(self, held: Held, now_ns: int) -> int:
        self._count_in(held)
        return self._push(held, now_ns)

    def _count_in(self, held: Held) -> None:
        self.held += 1
        self.held_bytes += held.n_bytes
        if self.held > self.most_held:
            self.most_held = self.held
        if self._evicts:
            self._by_age.append(held)

    def _push(self, held: Held, from_ns: int) -> int:
        release_ns = held.ordering.schedule(from_ns + held.delay_ns)
        held.release_ns = release_ns
        self._n_pushed += 1
        heappush(self._heap, (release_ns, self._n_pushed, held))
        return release_ns

    def _lose(self, held: Held, departure: Departure) -> Due:
        held.gone = True
        self.held -= 1
        self.held_bytes -= held.n_bytes
        self.dropped[departure] += 1
        return held.due(departure)

    def _drop(self, seq: int, outcome: Outcome, foreign: bool) -> Fate:
        self.dropped[outcome] += 1
        return Fate(seq, outcome, foreign=foreign)
