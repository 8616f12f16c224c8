"""The one loop that drives nodes, live, in virtual time and in replay; and the bus of virtual time."""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

from tis.common.channels import Network
from tis.common.messages import Header
from tis.common.node import Arrival, Emission, Node, Output, Record
from tis.common.runtime.clock import Clock, VirtualClock
from tis.common.zenoh_syntax import key_matches


class Delivery(NamedTuple):
    """An arrival, and the index of the seat that receives it."""

    seat: int
    arrival: Arrival


class Bus(Protocol):
    """Carries messages between seats of this process, or between this process and others."""

    def send(self, seat: int, emission: Emission) -> int:
        """Send a message; return the run time at which it left."""

    def wait(self, deadline_ns: int) -> Delivery | None:
        """Return the next arrival stamped at or before ``deadline_ns``, or None once that has passed.

        A live bus may also return None early, after an alarm.
        """


class Recorder(Protocol):
    """Logs records in order."""

    def record(self, record: Record) -> None:
        """Log one record."""


class LateRecorder(Recorder, Protocol):
    """Logs also records that are still to be made, off the hot path."""

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        """Log the records that ``make`` returns, in order with the others."""


@dataclass(frozen=True)
class Seat:
    """A node and the log it writes."""

    node: Node
    recorder: Recorder


def run(
    seats: Sequence[Seat], bus: Bus, clock: Clock, until_ns: int, stopped: Callable[[], bool] = lambda: False
) -> None:
    """Drive the nodes until run time ``until_ns``, or until ``stopped``; then log the last records of each.

    At equal times arrivals come before ticks, and ticks in the order of the seats: tick t uses every arrival
    stamped at or before t. No node is woken before it is due.
    """
    # Wake times are cached: only the node that was called can change its own.
    wakes_ns = [_wake_ns(seat.node, until_ns) for seat in seats]
    while not stopped():
        due_ns = min(wakes_ns)
        delivery = bus.wait(due_ns)
        if delivery is not None:
            # An arrival at or before the next wake.
            index = delivery.seat
            outputs: Iterable[Output] = seats[index].node.receive(delivery.arrival)
        else:
            # No arrival is left up to the next wake, unless the wait ended early.
            now_ns = clock.now_ns()
            if now_ns < due_ns:
                continue
            if due_ns >= until_ns:
                break
            index = wakes_ns.index(due_ns)  # the first of several seats that are due
            outputs = seats[index].node.wake(now_ns)
        _carry_out(outputs, index, seats[index], bus)
        wakes_ns[index] = _wake_ns(seats[index].node, until_ns)
    now_ns = clock.now_ns()
    for seat in seats:
        for record in seat.node.finish(now_ns):
            seat.recorder.record(record)


def _wake_ns(node: Node, until_ns: int) -> int:
    wake_ns = node.next_wake_ns()
    return until_ns if wake_ns is None else min(wake_ns, until_ns)


def _carry_out(outputs: Iterable[Output], index: int, seat: Seat, bus: Bus) -> None:
    for output in outputs:
        if isinstance(output, Record):
            seat.recorder.record(output)
        else:
            for record in output.on_sent(bus.send(index, output)):
                seat.recorder.record(record)


@dataclass
class VirtualBus:
    """A bus for several nodes; as live, a node does not receive its own messages."""

    nodes: Sequence[Node]
    clock: VirtualClock
    _queue: deque[Delivery] = field(default_factory=deque, repr=False)
    _routes: dict[tuple[int, Network, str], tuple[int, ...]] = field(default_factory=dict, repr=False)

    def send(self, seat: int, emission: Emission) -> int:
        """Deliver to every other node that listens on the emission's network and key."""
        now_ns = self.clock.now_ns()
        attachment = emission.attachment
        if isinstance(attachment, Header):
            attachment = attachment._replace(sent_ns=now_ns).pack()
        arrival = Arrival(emission.network, emission.key, emission.payload, attachment, now_ns)
        for other in self._route(seat, emission.network, emission.key):
            self._queue.append(Delivery(other, arrival))
        return now_ns

    def wait(self, deadline_ns: int) -> Delivery | None:
        """Return the next arrival, or advance the clock to the deadline and return None."""
        if self._queue:
            return self._queue.popleft()
        self.clock.advance(deadline_ns)
        return None

    def _route(self, sender: int, network: Network, key: str) -> tuple[int, ...]:
        address = (sender, network, key)
        if address not in self._routes:
            self._routes[address] = tuple(
                seat
                for seat, node in enumerate(self.nodes)
                if seat != sender
                and any(place == network and key_matches(expression, key) for place, expression in node.listens())
            )
        return self._routes[address]
