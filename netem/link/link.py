"""A link, one direction of the network: packets are offered, held as the models decide, and released."""

from collections import deque
from collections.abc import Iterable, Mapping
from heapq import heappop, heappush
from typing import Any, Final, NamedTuple

from tis.common.channels import Direction
from tis.common.records import Departure, Outcome
from tis.common.scenario.network import Buffer
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.netem.conditions.conditions import Condition, Conditions
from tis.netem.draws.blocks import HEAD, DeferredDraw
from tis.netem.draws.grid import CELL_NS
from tis.netem.link.flows import Flows
from tis.netem.link.ledger import DROPS, Ledger
from tis.netem.link.packet import Fate, Flow, Packet, flow_key, held_bytes
from tis.netem.link.queue.lines import DATA
from tis.netem.link.queue.queues import Queues
from tis.netem.link.queue.transmission import Service
from tis.netem.link.rules import LINK, RuleTable
from tis.netem.stages.impairment import Impairment
from tis.netem.stages.loss.recovery import Arrived, Connections
from tis.netem.stages.single_packets import flip_bits

_BYTES_PER_MB: Final = 1_000_000


class Door(NamedTuple):
    """The entry to the queue of a group, and whether a packet has room in it."""

    group: str
    has_room: bool


class Link:
    """One direction of the emulator: decides the fate of each packet, holds it, and records both.

    A driver calls `offer` for each packet, `release` at `next_release_ns`, and `left` once a packet that `release`
    returned has been sent. `lets_through` and `crossed` are the short cut for a packet that nothing holds back: it is
    sent first and recorded afterwards. Drivers are `tis.netem.node` (virtual time) and `tis.netem.bridge.bridge`
    (live). The link has no clock and no lock: instants are arguments, in ns of run time, and must not decrease.

    Parameters
    ----------
    direction
        ``forward`` (west to east) or ``feedback``; part of the address of every random number.
    rules, seed
        The pipeline of each key, and the seed of every random number.
    conditions
        Outages, states and timeline of this direction.
    traces
        Recorded networks, by the path that a pipeline names.
    buffer
        Bound on the packets held and on their memory (`tis.netem.link.packet`); beyond it packets are dropped.
    own_connections
        Whether each flow is a connection of its own that repeats what is lost, not one for all.

    Attributes
    ----------
    ledger : Ledger
        The records for the log; the driver closes their batches. It may be replaced before the first packet.
    offered, copied, released, dropped, held : int or dict of int
        Counts; always ``offered + copied == released + sum(dropped.values()) + held`` (oracle: conservation by
        hypothesis, tests/netem/link/test_link).

    Examples
    --------
    >>> from tis.common.scenario.network import NetworkPart
    >>> from tis.netem.build import build_links
    >>> network = NetworkPart.model_validate({"forward": {"delay": {"kind": "constant", "delay_ms": 40}}})
    >>> link = build_links(network, ["**"], seed=1, traces=None, where="example")["forward"]
    >>> link.offer("arm/pose", attachment=b"", n_bytes=8, now_ns=0, item="pose").release_ns
    40000000
    >>> [due.item for due in link.release(now_ns=40_000_000)]
    ['pose']
    """

    def __init__(
        self,
        direction: Direction,
        rules: RuleTable,
        seed: int,
        conditions: Conditions,
        traces: Mapping[str, Trace] | None = None,
        buffer: Buffer | None = None,
        own_connections: bool = False,
    ) -> None:
        self.direction: Final = direction
        self.conditions: Final = conditions
        self.ledger = Ledger(direction)
        self.rules = rules
        self.deferred: list[DeferredDraw] = []
        self.offered = 0
        self.copied = 0
        self.flipped = 0
        self.released = 0
        self.dropped: dict[str, int] = dict.fromkeys(DROPS, 0)
        self.held = 0
        self.held_bytes = 0
        self.most_held = 0
        self.run_id: int | None = None
        """Number of the run whose headers number the packets; None: of any run."""
        self._seed = seed
        self.traces: Final = traces or {}
        buffer = buffer or Buffer()
        self._max_held = buffer.max_packets
        self._max_bytes = round(buffer.max_mb * _BYTES_PER_MB)
        self._evicts = buffer.policy == "drop_oldest"
        self._by_age: deque[Packet] = deque()
        self._dropped: list[Packet] = []  # since the last `release`: evicted, by CoDel, or for a higher priority
        self.flows: Final = Flows()
        self._flows: Final = self.flows.open
        self._queues: Final = Queues(conditions, rules.pipelines, self.address(""), self.traces)
        self._servers: Final = self._queues.servers  # empty, and cheap to test, until a message meets a queue
        self._connections: Final = Connections(self._leaves_again_ns, own_connections)
        self._repeats: Final = self._connections.by_name  # empty until a packet's pipeline has a recovery
        self._clear_until_ns = 0
        self._condition = self.condition(0)
        # (release_ns, number, packet): the number breaks ties, so packets are never compared
        self._heap: list[tuple[int, int, Packet]] = []
        self._n_pushed = 0

    def prepare(self, names: Iterable[str]) -> None:
        """Open the flows of expected names and make their first draws, so that no packet waits for them."""
        for name in names:
            flow = self._flows.get(name) or self._open(name, 0)
            if flow.impairment is not None:
                for seq in (0, HEAD):  # whole blocks too
                    flow.impairment.decide(seq, seq * CELL_NS, 0, self._condition)
        self.run_deferred()

    def run_deferred(self, limit: int | None = None) -> None:
        """Draw blocks ahead of their use, at most ``limit`` of them; call it when the emulator is idle."""
        while self.deferred and limit != 0:
            self.deferred.pop()()
            limit = None if limit is None else limit - 1

    def address(self, name: str) -> Address:
        """Return the address of a flow's random numbers."""
        return Address(self._seed, self.direction, name)

    def condition(self, now_ns: int) -> Condition:
        """Return the condition that holds at ``now_ns``, for this and the next packets."""
        condition = self._condition = self.conditions.at(now_ns)
        self._queues.look_again(now_ns)
        self._clear_until_ns = condition.until_ns if condition.is_clear else 0
        return condition

    def offer(self, name: str, attachment: bytes, n_bytes: int, now_ns: int, item: Any, priority: int = DATA) -> Fate:
        """Decide and record the fate of a packet, and hold the packet unless it is dropped.

        Parameters
        ----------
        name
            The flow: a message's key, or a key with a mark before it (`flow_key`).
        attachment
            Our header, which has the sequence number; a packet with another attachment is foreign and counted.
        n_bytes
            Length of the payload.
        now_ns
            The instant of offering; the delay counts from it.
        item
            The packet, which `release` returns.
        priority
            Zenoh's, 1 (real time) to 7 (background), by which a queue of kind ``priority`` serves.

        Returns
        -------
        Fate
            The decision; ``release_ns`` is None for a dropped packet and in the queue of a rate.
        """
        self.offered += 1
        if self._servers or self._repeats:
            self.catch_up(now_ns)
        flow = self._flows.get(name) or self._open(name, now_ns)
        seq, foreign = flow.number(attachment, self.run_id)
        size = n_bytes + len(attachment)
        fate = self._decide(flow, seq, foreign, n_bytes, size, now_ns, item, priority)
        self.ledger.decided(name, fate, now_ns, n_bytes)
        return fate

    def door(self, name: str, n_bytes: int, now_ns: int) -> Door | None:
        """Return the entry to the queue that a packet would join now, None where nothing pushes back.

        ``n_bytes`` includes the attachment. In an outage nobody waits, since what is offered then is lost.
        """
        if self._servers:
            self.catch_up(now_ns)
        flow = self._flows.get(name) or self._open(name, now_ns)
        impairment = flow.impairment
        condition = self._condition if now_ns < self._condition.until_ns else self.condition(now_ns)
        if impairment is None or condition.outage:
            return None
        service, group = self._service_of(flow, impairment, condition)
        if service.capacity is None or not service.capacity.backpressure:
            return None
        return Door(group, self._queues.has_room(group, service, n_bytes, now_ns))

    def lets_through(self, name: str, n_bytes: int, now_ns: int) -> bool:
        """Tell whether nothing holds back a packet offered now; it may be sent at once, and `crossed` records it.

        That is so while the link is idle, the flow's pipeline has no stages and the conditions add none. It saves the
        time of a decision where the result is certain. ``n_bytes`` includes the attachment (oracle: `offer`, then
        `release`, tests/netem/link/test_crossing).
        """
        flow = self._flows.get(name)
        if flow is None or not flow.is_open or self.held or now_ns >= self._clear_until_ns or flow.changes:
            return False
        # the ordering comes last: its schedule remembers this packet
        return not (
            self._servers
            or self._dropped
            or held_bytes(n_bytes, flow.is_copied) > self._max_bytes
            or flow.ordering.schedule(now_ns) > now_ns
        )

    def crossed(self, name: str, attachment: bytes, n_bytes: int, offered_ns: int, released_ns: int) -> None:
        """Count and record a packet that `lets_through` admitted and that was sent at ``released_ns``."""
        flow = self._flows.get(name) or self._open(name, offered_ns)  # another flow may have closed it meanwhile
        seq, foreign = flow.number(attachment, self.run_id)
        self.offered += 1
        self.released += 1
        self.most_held = self.most_held or 1
        self.ledger.crossed(name, seq, foreign, offered_ns, released_ns, n_bytes)

    def next_release_ns(self) -> int | None:
        """Return the instant at which `release` has something to do; None while nothing is held."""
        if self._dropped:
            return self._dropped[0].offered_ns
        next_ns = self._heap[0][0] if self._heap else None
        queues_ns = self._queues.next_ns() if self._servers else None
        if self._repeats:
            repeats_ns = self._connections.next_ns()
            if queues_ns is None or (repeats_ns is not None and repeats_ns < queues_ns):
                queues_ns = repeats_ns
        return next_ns if queues_ns is None or (next_ns is not None and next_ns < queues_ns) else queues_ns

    def catch_up(self, now_ns: int) -> None:
        """Schedule what queues and the connection have sent until ``now_ns``, before anything else happens then."""
        if self._servers:
            self._depart(now_ns)
        if self._repeats:
            self._arrive(self._connections.advance(now_ns))

    def _depart(self, now_ns: int) -> None:
        departures = self._queues.depart(now_ns)
        if self._repeats:  # groups share a connection
            departures.sort(key=lambda departed: departed.left_ns)
        for departed in departures:
            packet: Packet = departed.item
            packet.queued_ns = departed.left_ns - packet.offered_ns
            packet.flow.n_queued -= 1
            if packet.departure is not None:  # evicted while it waited
                continue
            if departed.dropped:
                self._dropped.append(self._lose(packet, "queue_full" if departed.gives_way else "codel"))
            else:
                release_ns = self._send(packet, departed.left_ns)  # its delay counts from the end of its transmission
                if release_ns is not None and packet.ordering is not packet.flow.ordering:  # it has changed meanwhile
                    packet.flow.ordering.schedule(release_ns)

    def release(self, now_ns: int) -> list[Packet]:
        """Return the packets due at ``now_ns``, by release instant, equal ones in the order of offering.

        Packets that are dropped after all are returned too, for the log.
        """
        # Stage 1: the queues of rates, and packets that they or a full buffer have dropped since the previous call.
        self.catch_up(now_ns)
        due: list[Packet] = []
        if self._dropped:
            due, self._dropped = self._dropped, due
        # Stage 2: release instants, also of the packets that stage 1 has just scheduled.
        heap = self._heap
        while heap and heap[0][0] <= now_ns:
            packet = heappop(heap)[2]
            if packet.departure is not None:
                continue
            if packet.ordering.passes(packet.number):
                packet.departure = "released"
                self.held -= 1
                self.held_bytes -= packet.memory
                self.released += 1
                due.append(packet)
            else:
                due.append(self._lose(packet, "late"))
        return due

    def left(self, packet: Packet, released_ns: int) -> None:
        """Record that a packet that `release` returned was sent at ``released_ns``, or dropped."""
        packet.item = None  # the ledger keeps the packet until its batch is written
        self.ledger.left(packet, released_ns)

    def payload(self, packet: Packet, payload: bytes) -> bytes:
        """Return a packet's payload as it leaves, with the bits flipped that its fate has."""
        if not packet.n_flips:
            return payload
        return flip_bits(payload, packet.seq, packet.n_flips, self.address(packet.name))

    def queue_depth(self) -> tuple[int, int]:
        """Return the packets and bytes that wait in the queues of rates."""
        return self._queues.depth()

    @property
    def n_too_long(self) -> int:
        """Return the messages so far that were longer than the queue of their rate."""
        return self._queues.n_too_long

    def note_queue_depth(self, now_ns: int) -> None:
        """Record the depth of the queues of rates, if there are any."""
        if self._servers:
            self.ledger.queue_depth(now_ns, *self.queue_depth())

    @property
    def has_queues(self) -> bool:
        """Tell whether any packet has met a rate so far."""
        return bool(self._servers)

    @property
    def is_plain(self) -> bool:
        """Tell whether a packet that is held leaves at the instant that its fate gives, whatever comes after it."""
        return not (self._servers or self._evicts)

    def counters(self) -> dict[str, int]:
        """Return the counts, by name; ``held_at_end`` is the number held now; those of names only near a bound."""
        counts = {"offered": self.offered, "copied": self.copied, "released": self.released}
        counts |= {f"dropped.{cause}": count for cause, count in self.dropped.items()}
        counts |= {"held_at_end": self.held, "most_held": self.most_held, "flipped_bits": self.flipped}
        counts |= self.flows.counters()
        return {f"{self.direction}.{name}": count for name, count in counts.items()}

    def _open(self, name: str, now_ns: int) -> Flow:
        assigned = self.rules.assign(flow_key(name))
        if assigned is None:
            flow = Flow(name, None, "")
        else:
            impairment = Impairment(assigned.pipeline, self.address(name), self.traces, self.deferred)
            flow = Flow(name, impairment, assigned.group)
        self.flows.add(flow, now_ns)
        return flow

    def _decide(
        self, flow: Flow, seq: int, foreign: bool, n_bytes: int, size: int, now_ns: int, item: Any, priority: int
    ) -> Fate:
        # Stage 1, rules: a key that no rule admits has no impairment.
        impairment = flow.impairment
        if impairment is None:
            return self._drop(seq, "refused", foreign)
        # Stage 2, condition: cached until its next change, so most packets pay one comparison.
        condition = self._condition
        if now_ns >= condition.until_ns:
            condition = self.condition(now_ns)
        # Stage 3, draws: outage, loss, delay, copy and flips. They precede all that depends on earlier arrivals, so
        # a full buffer or queue shifts no other packet's numbers.
        draw = impairment.decide(seq, now_ns, n_bytes, condition)
        if isinstance(draw, str):
            return self._drop(seq, draw, foreign)
        if condition.changes is not flow.changes:
            flow.changes = condition.changes
            flow.ordering = flow.ordered(impairment.ordering)
            flow.ordering.schedule(flow.latest_ns)  # fifo also waits for what another ordering holds
        # Stage 4, memory.
        memory = held_bytes(size, flow.is_copied)
        if not self._make_room(memory, now_ns):
            return self._drop(seq, "overflow", foreign)
        # Stage 5, rate and order: the packet joins the queue of a rate, or is scheduled for release.
        delay_ns, n_flips, number, ordering = draw.delay_ns, draw.n_flips, self.offered, flow.ordering
        packet = Packet(
            flow, item, seq, 0, now_ns, delay_ns, size, memory, n_flips, foreign, number, ordering,
            is_lost=draw.is_lost, terms=impairment.terms,
        )  # fmt: skip
        waits = False
        if impairment.rate is not None or condition.stall or flow.n_queued:
            service, group = self._service_of(flow, impairment, condition)
            waits = service.is_needed
            if waits and not self._queue(packet, service, group, now_ns, priority):
                return self._drop(seq, "queue_full", foreign)
        release_ns = None if waits else self._hold(packet, now_ns)
        self.flipped += n_flips
        # Stage 6, copy: it takes the same path, and is skipped if there is no room for it.
        n_copies, copy_ns = 0, draw.copy_delay_ns
        if copy_ns is not None and self._make_room(memory, now_ns):
            copy = Packet(flow, item, seq, 1, now_ns, copy_ns, size, memory, n_flips, foreign, number, ordering)
            if waits:
                n_copies = int(self._queue(copy, service, group, now_ns, priority))
            else:
                self._hold(copy, now_ns)
                n_copies = 1
            self.copied += n_copies
        return Fate(seq, "deliver", delay_ns, release_ns, n_copies, n_flips, foreign, draw.is_lost)

    def _service_of(self, flow: Flow, impairment: Impairment, condition: Condition) -> tuple[Service, str]:
        """Return the terms on which a packet is sent now, and its group."""
        capacity, group = impairment.rate, flow.group
        if isinstance(capacity, str):  # "link": the capacity that the default pipeline shares with this one
            own = self.rules.default.rate
            capacity, group = None if isinstance(own, str) else own, LINK
        if flow.n_queued and flow.queue != group and impairment.ordering == "fifo":
            # in another queue a packet could overtake what waits here: the flow moves when nothing does
            return self._queues.service(flow.queue), flow.queue
        return Service(capacity, condition.scale_rate, condition.stall), group

    def _make_room(self, memory: int, now_ns: int) -> bool:
        """Tell whether a packet has room, which the eviction of older ones may give it."""
        if self.held < self._max_held and self.held_bytes + memory <= self._max_bytes:
            return True
        if not self._evicts:
            return False
        while self._by_age and (self.held >= self._max_held or self.held_bytes + memory > self._max_bytes):
            oldest = self._by_age.popleft()
            if oldest.departure is None:
                oldest.release_ns = now_ns
                self._dropped.append(self._lose(oldest, "evicted"))
        return self.held < self._max_held and self.held_bytes + memory <= self._max_bytes

    def _queue(self, packet: Packet, service: Service, group: str, now_ns: int, priority: int) -> bool:
        """Put a packet into the queue of a group; False: the queue is full."""
        if not self._queues.offer(group, service, packet, packet.n_bytes, now_ns, priority):
            return False
        packet.flow.n_queued += 1
        packet.flow.queue = group
        self._count_in(packet)
        return True

    def _hold(self, packet: Packet, now_ns: int) -> int | None:
        self._count_in(packet)
        return self._send(packet, now_ns)

    def _count_in(self, packet: Packet) -> None:
        self.held += 1
        self.held_bytes += packet.memory
        if self.held > self.most_held:
            self.most_held = self.held
        if self._evicts:
            self._by_age.append(packet)

    def _send(self, packet: Packet, from_ns: int) -> int | None:
        """Send a packet; return its release instant, or None while it waits for a repeat."""
        due_ns: int | None = from_ns + packet.delay_ns
        terms = packet.flow.terms = packet.terms or packet.flow.terms
        if terms is not None:  # also of a flow that no longer has any: nothing overtakes what waits
            connection = self._connections.of(packet.flow.name)
            self._arrive(connection.advance(from_ns))
            due_ns = connection.send(packet, from_ns, packet.delay_ns, packet.n_bytes, packet.is_lost, terms)
        if due_ns is None:
            packet.flow.n_awaited += 1
            return None
        return self._push(packet, from_ns, due_ns)

    def _leaves_again_ns(self, packet: Packet, n: int, at_ns: int) -> int | None:
        impairment = packet.flow.impairment
        assert impairment is not None, "it was offered"
        return impairment.leaves_again_ns(packet.seq, n, at_ns, self.conditions)

    def _arrive(self, arrived: Iterable[Arrived]) -> None:
        for packet, from_ns, due_ns in arrived:
            packet.flow.n_awaited -= 1
            if packet.departure is None:  # else evicted while it waited
                self._push(packet, from_ns, due_ns)

    def _push(self, packet: Packet, from_ns: int, due_ns: int) -> int:
        packet.recovered_ns = due_ns - from_ns - packet.delay_ns
        release_ns = packet.release_ns = packet.ordering.schedule(due_ns)
        flow = packet.flow
        if release_ns > flow.latest_ns:
            flow.latest_ns = release_ns
        self._n_pushed = n = self._n_pushed + 1
        heappush(self._heap, (release_ns, n, packet))
        return release_ns

    def _lose(self, packet: Packet, departure: Departure) -> Packet:
        packet.departure = departure
        self.held -= 1
        self.held_bytes -= packet.memory
        self.dropped[departure] += 1
        return packet

    def _drop(self, seq: int, outcome: Outcome, foreign: bool) -> Fate:
        self.dropped[outcome] += 1
        return Fate(seq, outcome, foreign=foreign)
