"""The queue between Zenoh's callback threads and the loop, with a precise wait that needs no privilege.

A callback stamps and appends under one lock and does nothing else. Draining sets a watermark, so that no arrival can
have a stamp that a tick has already passed. The wait is `select` on an eventfd: with a timer slack of 1 ns it is late
by some 20 us at the median, a condition variable by some 70 us.
"""

import os
import select
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple, TypeVar

from tis.common.channels import Network
from tis.common.runtime.clock import Clock

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
