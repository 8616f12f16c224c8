"""Bus over Zenoh for surgeon and patient; netem forwards by `tis.netem.bridge.bridge`."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import zenoh

from tis.common.channels import Network
from tis.common.header import Header
from tis.common.node import Arrival, Emission, Node
from tis.common.runtime.clock import Clock
from tis.common.runtime.inbox import Inbox
from tis.common.runtime.loop import Delivery
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.signing import RunKeys

MAX_FOREIGN_WAITING: Final = 1000
"""Messages of one device or arm of others that may wait for the loop: a second at 1 kHz."""


class ForeignBound(NamedTuple):
    """How many messages of a program of others may wait for the loop, and how long each may be."""

    n_waiting: int = MAX_FOREIGN_WAITING
    n_bytes: int = 64 * 1024


_OF_POSES: Final = ForeignBound()


@dataclass
class ZenohBus:
    """The bus of one live process."""

    sessions: Mapping[Network, zenoh.Session]
    clock: Clock
    inbox: Inbox[zenoh.Sample]
    run_id: int = 0
    keys: RunKeys | None = None
    """The run's keys, where messages are signed."""
    busy_since_ns: int | None = None
    """When the last wait ended; None while the loop waits."""
    _publishers: dict[tuple[Network, str], zenoh.Publisher] = field(default_factory=dict, repr=False)
    _subscribers: list[zenoh.Subscriber[None]] = field(default_factory=list, repr=False)

    def listen(self, node: Node, foreign_keys: Collection[str] = (), bound: ForeignBound = _OF_POSES) -> None:
        """Subscribe to the node's key expressions, for messages of other processes only.

        Of ``foreign_keys``, those of devices, arms and cameras of others, few and short messages wait, by ``bound``.
        """
        for network, key in node.listens():
            receive = self.inbox.receiver(network)
            if key in foreign_keys:
                receive = self._short(self.inbox.receiver(network, bound.n_waiting), bound.n_bytes)
            session = self.sessions[network]
            self._subscribers.append(session.declare_subscriber(key, receive, allowed_origin=zenoh.Locality.REMOTE))

    def _short(self, receive: Callable[[zenoh.Sample], None], n_bytes: int) -> Callable[[zenoh.Sample], None]:
        """Return a callback that drops and counts long messages before they wait."""

        def receive_short(sample: zenoh.Sample) -> None:
            if len(sample.payload) > n_bytes:
                self.inbox.n_flooded += 1
            else:
                receive(sample)

        return receive_short

    def announce(self, node: Node) -> None:
        """Declare the node's publishers in advance: it takes milliseconds, too long for the first tick."""
        for network, key in node.publishes():
            self._declare(network, key)

    def send(self, seat: int, emission: Emission) -> int:  # noqa: ARG002  (one seat in a live process)
        """Put a message on its network: reliable, but dropped when a queue stays full, without blocking.

        Not *express*: each message would then be a batch, and the copies of a sample could fill Zenoh's queue while
        its thread has to wait. Batched together they take one place, and an idle thread sends without delay.
        """
        publisher = self._publishers.get((emission.network, emission.key))
        if publisher is None:
            publisher = self._declare(emission.network, emission.key)
        attachment = emission.attachment
        sent_ns = self.clock.now_ns()
        if isinstance(attachment, Header):
            attachment = attachment._replace(sent_ns=sent_ns, run_id=self.run_id).pack()
            if self.keys is not None:
                attachment = self.keys.sign(emission.key, attachment, emission.payload)
        publisher.put(emission.payload, attachment=attachment)
        return sent_ns

    def _declare(self, network: Network, key: str) -> zenoh.Publisher:
        publisher = self._publishers[network, key] = publisher_of(self.sessions[network], key, express=False)
        return publisher

    def wait(self, deadline_ns: int) -> Delivery | None:
        """Return the next arrival stamped at or before the deadline, None when there is none."""
        self.busy_since_ns = None
        stamped = self.inbox.wait(deadline_ns)
        self.busy_since_ns = self.clock.now_ns()
        if stamped is None:
            return None
        sample = stamped.item
        attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
        payload = sample.payload.to_bytes()
        return Delivery(0, Arrival(stamped.network, str(sample.key_expr), payload, attachment, stamped.recv_ns))
