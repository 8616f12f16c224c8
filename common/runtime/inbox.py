"""The queue between Zenoh's callback threads and the loop, and the most exact wait that needs no privilege.

A callback stamps and appends under one lock and does nothing else. Draining sets a watermark, so that an arrival
can never turn up with a stamp that a tick has already passed. The wait is `select` on an eventfd: with the timer
slack set to 1 ns it is late by some 20 us at the median, where a condition variable is late by some 70.
"""

import contextlib
import ctypes
import os
import select
import threading
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, Generic, NamedTuple, TypeVar

from common.channels import Network
from common.runtime.clock import Clock

_PR_SET_TIMERSLACK: Final = 29

_BEHIND, _PRIORITY = 1, 2
_THREADS: Final = Path("/proc/self/task")

T = TypeVar("T")


class Stamped(NamedTuple, Generic[T]):
    """What came in on a network, and its effective stamp in run time."""

    network: Network
    recv_ns: int
    item: T


def sharpen_timers() -> None:
    """Ask the kernel not to group this thread's timers (Linux, no privilege needed; elsewhere without effect)."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)


def ask_for_real_time() -> bool:
    """Ask that all threads of this process, and those to come, run before ordinary ones; say whether they do.

    Linux grants it to root, with CAP_SYS_NICE, or within RLIMIT_RTPRIO; else nothing changes. All threads, and not
    the loop's alone: it waits for whoever holds the interpreter's lock. Those of equal priority take turns
    (SCHED_RR), and the kernel keeps a share of the time for ordinary processes.
    """
    wanted = os.sched_param(_PRIORITY)
    try:
        for thread in _THREADS.iterdir():
            with contextlib.suppress(ProcessLookupError):  # it has ended meanwhile
                os.sched_setscheduler(int(thread.name), os.SCHED_RR, wanted)
    except OSError:
        return False
    return True


def give_way() -> None:
    """Put this thread behind all loops of this host that run in real time, if it runs so itself.

    For work that takes a while without the interpreter's lock: loops of equal priority would have to wait for it.
    """
    with contextlib.suppress(OSError):
        if os.sched_getscheduler(0) == os.SCHED_RR:
            os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(_BEHIND))


class Inbox(Generic[T]):
    """Stamped arrivals in the order of their stamps."""

    def __init__(self) -> None:
        self._clock: Clock | None = None
        self._lock = threading.Lock()
        self._queue: deque[Stamped[T]] = deque()
        self._watermark_ns = -1
        self._alarm = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self.n_early = 0
        self.error: BaseException | None = None

    def start(self, clock: Clock) -> None:
        """Begin to take arrivals in; what came before the epoch is counted and dropped."""
        self._clock = clock

    def receiver(self, network: Network) -> Callable[[T], None]:
        """Return the callback for one network: it stamps, appends and wakes the loop."""
        lock, queue = self._lock, self._queue

        def receive(item: T) -> None:
            try:
                with lock:
                    recv_ns = -1 if self._clock is None else self._clock.now_ns()
                    if recv_ns < 0:
                        self.n_early += 1
                        return
                    if recv_ns <= self._watermark_ns:
                        recv_ns = self._watermark_ns + 1
                    queue.append(Stamped(network, recv_ns, item))
                self.alarm()
            except BaseException as error:
                self.error = error

        return receive

    def wait(self, deadline_ns: int) -> Stamped[T] | None:
        """Return the next arrival stamped at or before ``deadline_ns``, None when there is none or on `alarm`."""
        clock = self._clock
        assert clock is not None, "start() comes before wait()"
        while True:
            with self._lock:
                if self._queue:
                    if self._queue[0].recv_ns <= deadline_ns:
                        return self._queue.popleft()
                    self._pass_over(deadline_ns)
                    return None
                remaining_ns = deadline_ns - clock.now_ns()
                if remaining_ns <= 0:
                    self._pass_over(deadline_ns)
                    return None
            ready: tuple[list[Any], ...] = select.select((self._alarm,), (), (), remaining_ns * 1e-9)
            if ready[0]:
                os.eventfd_read(self._alarm)
                if not self._queue:
                    return None

    def _pass_over(self, deadline_ns: int) -> None:
        self._watermark_ns = max(self._watermark_ns, deadline_ns)

    def alarm(self) -> None:
        """End the current wait early; safe from a signal handler."""
        os.eventfd_write(self._alarm, 1)
