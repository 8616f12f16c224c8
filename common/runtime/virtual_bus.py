"""Bus between nodes of one process, in virtual time: messages arrive at the instant at which they are sent."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

from tis.common.channels import Network
from tis.common.header import Header
from tis.common.node import Arrival, Emission, Node
from tis.common.runtime.clock import VirtualClock
from tis.common.runtime.loop import Delivery


def key_matches(expression: str, key: str) -> bool:
    """Tell whether a key expression of literal chunks and ``**`` includes ``key``, as in Zenoh.

    ``**`` matches any chunks except those that begin with ``@``.
    """
    return _chunks_match(expression.split("/"), key.split("/"))


def _chunks_match(pattern: Sequence[str], chunks: Sequence[str]) -> bool:
    if not pattern:
        return not chunks
    # ** takes any number of chunks; each number is tried.
    if pattern[0] == "**":
        rests = range(len(chunks) + 1)
        return any(
            _chunks_match(pattern[1:], chunks[n:])
            for n in rests
            if not any(chunk.startswith("@") for chunk in chunks[:n])
        )
    return bool(chunks) and pattern[0] == chunks[0] and _chunks_match(pattern[1:], chunks[1:])


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
