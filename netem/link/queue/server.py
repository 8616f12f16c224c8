"""The server of a link: messages of all its keys share one queue and are sent one after the other."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple, Self

from tis.common.scenario.network import capacity
from tis.common.scenario.network.capacity import Capacity, PriorityQueue
from tis.common.scenario.network.capacity import CoDel as CoDelPart
from tis.common.streams import Address
from tis.common.trace import Trace
from tis.common.units import NS_PER_S
from tis.netem.link.queue.codel import CoDel
from tis.netem.link.queue.cross_traffic import CrossTraffic
from tis.netem.link.queue.lines import DATA, Fifo, Lines, Waiting
from tis.netem.link.queue.transmission import Service, transmission_of

MEMORY_NS: Final = 10 * NS_PER_S
"""The time for which the traffic of others is followed back, once a queue had no message of its own for longer."""


class TailDrop(NamedTuple):
    """The bounds of a queue of any kind; a message that finds it full is dropped on arrival, if nothing gives way."""

    max_packets: int
    max_bytes: int | None = None

    @classmethod
    def of(cls, part: capacity.Queue) -> Self:
        """Return the bounds of a scenario's queue."""
        return cls(part.max_packets, part.max_bytes)

    def admits(self, n_packets: int, n_bytes: int, arriving_bytes: int) -> bool:
        """Tell whether a message of ``arriving_bytes`` fits beside ``n_packets`` with ``n_bytes`` in total."""
        if n_packets >= self.max_packets:
            return False
        return self.max_bytes is None or n_bytes + arriving_bytes <= self.max_bytes


_UNBOUNDED: Final = TailDrop(1 << 62)


class Departed(NamedTuple):
    """A message whose last bit was sent at ``left_ns``, or which was ``dropped`` then.

    CoDel drops at the head of the queue; a message ``gives_way`` to one of a higher priority.
    """

    item: Any
    offered_ns: int
    left_ns: int
    dropped: bool
    gives_way: bool = False


class Server:
    """A server with a bounded queue that includes the message being sent: first come, first served, or by priority.

    Messages of others stand in the same queue, count for its bounds and are never returned. Instants must not
    decrease from call to call; an earlier one counts as the latest so far. The result depends on the offers alone,
    not on the calls of `depart` (oracles: a simulation of all arrivals at once, the Pollaczek-Khinchine formula;
    tests/netem/link/queue). At equal instants a transmission ends before a message is offered, which makes room.

    ``address`` is that of the traffic of others, ``traces`` has the recordings that capacities name.
    """

    def __init__(self, service: Service, address: Address, traces: Mapping[str, Trace] | None = None) -> None:
        self.service = service
        self.n_packets = 0
        """Messages in the queue, including the one being sent, without those of others."""
        self.n_bytes = 0
        """Their bytes, including the overhead of each."""
        self.n_too_long = 0
        """Messages so far that no empty queue would take."""
        self._address: Final = address
        self._traces: Final = traces or {}
        self._transmission = transmission_of(service, self._traces)
        capacity = service.capacity
        self._overhead_bytes = 0 if capacity is None else capacity.overhead_bytes
        self._bounds = _UNBOUNDED if capacity is None else TailDrop.of(capacity.queue)
        self._codel = _codel_of(capacity)
        self._cross: CrossTraffic | None = None
        self._n_all = self._all_bytes = 0
        self._longest_bytes = 0
        self._waiting: Fifo | Lines = _waiting_for(capacity)
        self._sending: Waiting | None = None
        self._departed: list[Departed] = []
        self._now_ns = 0
        self._follow_cross(0)

    @property
    def is_shared(self) -> bool:
        """Tell whether others send here, so that time passes also while no message of ours waits."""
        return self._cross is not None

    def offer(self, item: Any, n_bytes: int, now_ns: int, priority: int = DATA) -> bool:
        """Put a message of ``n_bytes`` (without overhead) into the queue; False if it is full."""
        now_ns = self._advance(now_ns)
        n_bytes += self._overhead_bytes
        if not self._join(item, n_bytes, now_ns, priority):
            return False
        self.n_packets += 1
        self.n_bytes += n_bytes
        return True

    def has_room(self, n_bytes: int, now_ns: int) -> bool:
        """Tell whether a message of ``n_bytes`` (without overhead) fits now, or never will."""
        self._advance(now_ns)
        n_bytes += self._overhead_bytes
        return self._admits(n_bytes) or not self._bounds.admits(0, 0, n_bytes)

    def next_departure_ns(self) -> int | None:
        """Return the next departure, unless the service changes before it; None if none of ours waits.

        Where others send it may be a departure of theirs.
        """
        if self._departed:
            return self._departed[0].left_ns
        return self._transmission.free_ns if self.n_packets else None

    def depart(self, now_ns: int) -> list[Departed]:
        """Return, in order, the messages sent or dropped until ``now_ns`` that were not returned before."""
        if self.n_packets:
            self._advance(now_ns, while_ours=True)
        departed, self._departed = self._departed, []
        return departed

    def set_service(self, service: Service, now_ns: int) -> None:
        """Change the terms at ``now_ns``, not before an earlier call's instant.

        Bits not yet sent take the new capacity, also those of the message being sent; without one everything that
        waits leaves now, and in a stall nothing. New bounds and a new overhead apply to later offers; no waiting
        message is dropped. CoDel restarts if its parameters differ, and so does the traffic of others.
        """
        if service.equals(self.service):
            return
        now_ns = self._advance(now_ns)
        before, self.service = self.service.capacity, service
        left = self._transmission.left(now_ns)
        self._transmission = transmission_of(service, self._traces)
        if self._sending is not None:
            self._transmission.resume(left, now_ns)
        capacity = service.capacity
        if capacity is None:
            self._overhead_bytes, self._bounds = 0, _UNBOUNDED
        else:
            self._overhead_bytes, self._bounds = capacity.overhead_bytes, TailDrop.of(capacity.queue)
        if _control(capacity) != _control(before):
            self._codel = _codel_of(capacity)
        waiting = _waiting_for(capacity)
        if type(waiting) is not type(self._waiting):
            waiting.extend(self._waiting.in_order())
            self._waiting = waiting
        self._follow_cross(now_ns)
        self._advance(now_ns)

    def _follow_cross(self, now_ns: int) -> None:
        part = None if self.service.capacity is None else self.service.capacity.cross
        if part is None:
            self._cross = None
        elif self._cross is None or self._cross.part != part:
            self._cross = CrossTraffic(part, self._address, now_ns)

    def _advance(self, now_ns: int, while_ours: bool = False) -> int:
        """Process all events until ``now_ns``, or only ``while_ours`` wait; return the latest instant so far."""
        if now_ns < self._now_ns:
            now_ns = self._now_ns
        cross = self._cross
        if cross is not None:
            if not self.n_packets and now_ns - MEMORY_NS > self._now_ns:
                self._forget(cross, now_ns - MEMORY_NS)
            while cross.next_ns <= now_ns:
                at_ns = cross.next_ns
                self._transmit(at_ns)
                if while_ours and not self.n_packets:
                    self._now_ns = at_ns
                    return at_ns
                self._join(None, cross.n_bytes, at_ns, DATA)
                cross.pass_one()
        self._now_ns = now_ns
        self._transmit(now_ns)
        return now_ns

    def _forget(self, cross: CrossTraffic, now_ns: int) -> None:
        """Begin anew with an empty queue: nobody saw what became of the messages of others."""
        self._waiting = _waiting_for(self.service.capacity)
        self._sending = None
        self._n_all = self._all_bytes = 0
        self._transmission = transmission_of(self.service, self._traces)
        cross.skip_to(now_ns)

    def _admits(self, n_bytes: int) -> bool:
        return self._bounds.admits(self._n_all, self._all_bytes, n_bytes)

    def _join(self, item: Any, n_bytes: int, now_ns: int, priority: int) -> bool:
        """Put a message into the queue, None for one of others; False if it is full."""
        if not self._admits(n_bytes):
            n_below, bytes_below = self._waiting.below(priority)
            if not self._bounds.admits(self._n_all - n_below, self._all_bytes - bytes_below, n_bytes):
                self.n_too_long += item is not None and not self._bounds.admits(0, 0, n_bytes)
                return False
            while not self._admits(n_bytes):
                self._leave(self._waiting.pop_last(), now_ns, dropped=True, gives_way=True)
        self._n_all += 1
        self._all_bytes += n_bytes
        if n_bytes > self._longest_bytes:
            self._longest_bytes = n_bytes
        if self._sending is None:
            self._sending = Waiting(item, n_bytes, now_ns, priority)
            self._transmission.send(n_bytes, now_ns)
        else:
            self._waiting.append(Waiting(item, n_bytes, now_ns, priority))
        return True

    def _transmit(self, now_ns: int) -> None:
        """Let all leave whose transmission ends until ``now_ns``."""
        while self._sending is not None and self._transmission.free_ns <= now_ns:
            left_ns = self._transmission.free_ns
            self._leave(self._sending, left_ns, dropped=False)
            self._sending = self._next(left_ns)

    def _next(self, now_ns: int) -> Waiting | None:
        """Begin to send the next message that is not dropped, and return it; None if the queue is empty."""
        codel = self._codel
        while self._waiting:
            head = self._waiting.popleft()
            _, n_bytes, offered_ns, _ = head
            if codel is not None:
                is_short = self._all_bytes - n_bytes <= self._longest_bytes
                if codel.drops(now_ns - offered_ns, is_short, now_ns):
                    self._leave(head, now_ns, dropped=True)
                    continue
            self._transmission.send(n_bytes, offered_ns)
            return head
        return None

    def _leave(self, message: Waiting, left_ns: int, dropped: bool, gives_way: bool = False) -> None:
        item, n_bytes, offered_ns, _ = message
        self._n_all -= 1
        self._all_bytes -= n_bytes
        if item is not None:
            self.n_packets -= 1
            self.n_bytes -= n_bytes
            self._departed.append(Departed(item, offered_ns, left_ns, dropped, gives_way))


def _waiting_for(capacity: Capacity | None) -> Fifo | Lines:
    return Lines() if capacity is not None and isinstance(capacity.queue, PriorityQueue) else Fifo()


def _codel_of(capacity: Capacity | None) -> CoDel | None:
    queue = None if capacity is None else capacity.queue
    return CoDel.of(queue) if isinstance(queue, CoDelPart) else None


def _control(capacity: Capacity | None) -> tuple[float, float] | None:
    queue = None if capacity is None else capacity.queue
    return (queue.target_ms, queue.interval_ms) if isinstance(queue, CoDelPart) else None
