"""Scheduling of this process's threads, by the kernel (Linux) and by Python: when they wake, and which goes first."""

import contextlib
import ctypes
import gc
import os
import sys
from pathlib import Path
from typing import Final

from tis.common.runtime.memory import keep_heap_level

_PR_SET_TIMERSLACK: Final = 29
_SWITCH_S: Final = 0.0001  # between threads that want the interpreter: a fiftieth of Python's default
_BEHIND, _PRIORITY = 1, 2
_NICE: Final = -15
_THREADS: Final = Path("/proc/self/task")
_ZENOH: Final = (b"rx-", b"tx-")
"""Beginnings of the names of Zenoh's threads that receive and send."""


def sharpen_timers() -> None:
    """Set the timer slack of this thread to its minimum (Linux, no privilege needed; elsewhere without effect)."""
    prctl = getattr(ctypes.CDLL(None), "prctl", None)
    if prctl is not None:
        prctl(_PR_SET_TIMERSLACK, 1, 0, 0, 0)


def request_real_time() -> bool:
    """Request real-time scheduling for all present and future threads of this process; return whether it holds.

    Linux grants it to root, with CAP_SYS_NICE, or within RLIMIT_RTPRIO; else nothing changes. It applies to all
    threads, since the loop waits for any thread that holds the interpreter's lock. Threads of equal priority take
    turns (SCHED_RR), and the kernel reserves a share of the time for ordinary processes.
    """
    requested = os.sched_param(_PRIORITY)
    try:
        for thread in _THREADS.iterdir():
            with contextlib.suppress(ProcessLookupError):  # the thread has ended meanwhile
                os.sched_setscheduler(int(thread.name), os.SCHED_RR, requested)
    except OSError:
        return False
    return True


def stand_behind(thread_id: int, behind: bool) -> None:
    """Set a thread's real-time priority, if it has one, below that of all loops on this host, or equal to theirs.

    ``thread_id`` is the kernel's, 0 for the calling thread. Behind the loops belongs long work without the
    interpreter's lock, which would delay loops of equal priority; it may get no processor as long as loops want all.
    """
    with contextlib.suppress(OSError):
        if os.sched_getscheduler(thread_id) == os.SCHED_RR:
            os.sched_setscheduler(thread_id, os.SCHED_RR, os.sched_param(_BEHIND if behind else _PRIORITY))


def precede_ordinary() -> None:
    """Let all threads of this process, and those that they begin, precede ordinary ones, but no real-time thread.

    With a real-time priority, also a lower one, they would take turns with the threads that write the loops' logs,
    for which a loop waits while they hold its interpreter.
    """
    with contextlib.suppress(OSError):  # it needs the same privilege as a real-time priority
        for thread in _THREADS.iterdir():
            os.setpriority(os.PRIO_PROCESS, int(thread.name), _NICE)


def let_zenoh_wait() -> None:
    """Let no thread of Zenoh that receives or sends interrupt a running one when it is woken (SCHED_BATCH).

    By default the sending thread, which a `put` wakes, may interrupt the thread that puts, in the middle of its
    releases, and so may a receiving thread when a message arrives. Threads that those begin later inherit the policy.
    It needs no privilege. Real-time threads keep theirs: equal priorities do not interrupt each other. Threads that
    ZENOH_RUNTIME merges with others have other names and are left alone.
    """
    with contextlib.suppress(OSError):
        for thread in _THREADS.iterdir():
            with contextlib.suppress(OSError):  # the thread has ended meanwhile
                is_zenoh = (thread / "comm").read_bytes().startswith(_ZENOH)
                if is_zenoh and os.sched_getscheduler(int(thread.name)) == os.SCHED_OTHER:
                    os.sched_setscheduler(int(thread.name), os.SCHED_BATCH, os.sched_param(0))


def settle(privileged: bool = True) -> None:
    """Tune this process for real time; it takes a while, so it comes before the side reports to be ready.

    ``privileged``: also by means that the system grants to privileged users only.
    """
    sharpen_timers()
    if privileged:
        request_real_time()
    sys.setswitchinterval(_SWITCH_S)
    gc.collect()
    gc.freeze()
    gc.disable()  # the loop creates no cycles, and a full collection would stall it for milliseconds
    keep_heap_level()


def give_way() -> None:
    """Undo `settle` for this thread, whose work in real time is over: what it computes now must delay no loop."""
    with contextlib.suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    gc.enable()
