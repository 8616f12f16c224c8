"""Bus over Zenoh for surgeon and patient; netem forwards by `tis.netem.bridge.bridge`."""

import os
import select
import threading
from collections import deque
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Generic, NamedTuple, TypeVar

import zenoh

from tis.common.channels import Network
from tis.common.messages import Header
from tis.common.node import Arrival, Emission, Node
from tis.common.runtime.clock import Clock
from tis.common.runtime.loop import Delivery
from tis.common.runtime.zenoh_session import publisher_of
from tis.common.signing import RunKeys

# The queue between Zenoh's callback threads and the loop, with a precise wait that needs no privilege.
#
# A callback stamps and appends under one lock and does nothing else. Draining sets a watermark, so that no arrival
# can have a stamp that a tick has already passed. The wait is `select` on an eventfd: with a timer slack of 1 ns it
# is late by some 20 us at the median, a condition variable by some 70 us.

T = TypeVar("T")


@dataclass
class Share:
    """The share of the queue that one subscription may take: messages that wait, and how many may."""

    limit: int
    n_waiting: int = 0


class Stamped(NamedTuple, Generic[T]):
    """An arrival on a network, its effective stamp in run time, and the share that it takes while it waits."""

    network: Network
    recv_ns: int
    item: T
    share: Share | None = None


class Inbox(Generic[T]):
    """Stamped arrivals in the order of their stamps."""

    def __init__(self) -> None:
        self._clock: Clock | None = None
        self._lock = threading.Lock()
        self._queue: deque[Stamped[T]] = deque()
        self._watermark_ns = -1
        self._alarm = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.n_early = 0
        self.n_flooded = 0
        self.error: BaseException | None = None

    def start(self, clock: Clock) -> None:
        """Begin to accept arrivals; those before the epoch are counted and dropped."""
        self._clock = clock

    def receiver(self, network: Network, limit: int | None = None) -> Callable[[T], None]:
        """Return the callback for one network: it stamps, appends and wakes the loop.

        While ``limit`` of its messages wait, further ones are counted and dropped: a program of others must not fill
        the memory.
        """
        lock, queue = self._lock, self._queue
        share = None if limit is None else Share(limit)

        def receive(item: T) -> None:
            try:
                with lock:
                    recv_ns = -1 if self._clock is None else self._clock.now_ns()
                    if recv_ns < 0:
                        self.n_early += 1
                        return
                    if share is not None:
                        if share.n_waiting >= share.limit:
                            self.n_flooded += 1
                            return
                        share.n_waiting += 1
                    # A tick has used all arrivals up to the watermark, so this one must be stamped later.
                    if recv_ns <= self._watermark_ns:
                        recv_ns = self._watermark_ns + 1
                    queue.append(Stamped(network, recv_ns, item, share))
                self.alarm()
            except BaseException as error:  # Zenoh would swallow it; the loop raises it
                self.error = error

        return receive

    def wait(self, deadline_ns: int) -> Stamped[T] | None:
        """Return the next arrival stamped at or before ``deadline_ns``, None when there is none or on `alarm`.

        Each arrival rings, too: after one that was returned at once, the next wait may end with None early.
        """
        clock = self._clock
        assert clock is not None, "start() comes before wait()"
        while True:
            # Clock and queue are read under one lock: no arrival can be stamped before a deadline that has passed.
            with self._lock:
                if self._queue:
                    if self._queue[0].recv_ns <= deadline_ns:
                        stamped = self._queue.popleft()
                        if stamped.share is not None:
                            stamped.share.n_waiting -= 1
                        return stamped
                    self._raise_watermark(deadline_ns)
                    return None
                remaining_ns = deadline_ns - clock.now_ns()
                if remaining_ns <= 0:
                    self._raise_watermark(deadline_ns)
                    return None
            ready: tuple[list[Any], ...] = select.select((self._alarm,), (), (), remaining_ns * 1e-9)
            if ready[0]:
                os.eventfd_read(self._alarm)
                if not self._queue:
                    return None

    def _raise_watermark(self, deadline_ns: int) -> None:
        self._watermark_ns = max(self._watermark_ns, deadline_ns)

    def alarm(self) -> None:
        """End the current wait early; safe from a signal handler."""
        os.eventfd_write(self._alarm, 1)


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
