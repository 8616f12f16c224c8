"""Calls to Zenoh that do not return: their detection, and the end of the process despite them.

Zenoh runs in netem's process. A call that waits for ever, for whatever lock, would leave a process that carries
nothing and cannot be stopped: two networks would look cut off for a reason that no log names. So threads are watched
(`StandstillWatch`), state is kept by threads of its own (`SerialExecutor`), and the end has a deadline.

netem's router may also deadlock by itself. netem never reads a router's admin space, but with ``--cfg
adminspace/enabled:true`` others may, and up to Zenoh 1.10 that may lock the routing tables forever (Zenoh's pull
request 2619). The process then accepts connections but routes nothing, and closing its sessions hangs.
"""

import os
import queue
import select
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Final, Protocol

import zenoh

from tis.common.errors import Fault, PeerError

_TURN_S: Final = 0.5
_STANDSTILL_S: Final = 8.0
_PATIENCE_S: Final = 6.0
_GLANCE_S: Final = 0.1
_ENDING: Final = frozenset((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))
_TIMEOUT_S: Final = 3.0
_CLOSING_S: Final = 3.0
_UNUSED_KEY: Final = "@tis/netem/nobody"


@dataclass(slots=True, eq=False)
class Pulse:
    """The life of one thread: busy or waiting, and a count that grows with all that it does."""

    who: str
    n: int = 0
    is_busy: bool = False

    @contextmanager
    def busy(self) -> Iterator[None]:
        """Count the block as one deed, which must come to its end."""
        self.n += 1
        self.is_busy = True
        try:
            yield
        finally:
            self.is_busy = False


class StandstillWatch:
    """Calls ``on_standstill`` once, with a thread's name and the time in s, if it is busy with one deed for 8 s.

    The time is counted in turns of the watch's own thread, so a suspended process is no standstill.
    """

    def __init__(
        self,
        on_standstill: Callable[[str, float], None],
        turn_s: float = _TURN_S,
        standstill_s: float = _STANDSTILL_S,
    ) -> None:
        self._on_standstill = on_standstill
        self._turn_s = turn_s
        self._standstill_s = standstill_s
        self._seen: dict[Pulse, tuple[int, int]] = {}
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="standstill", daemon=True)

    def watch(self, pulse: Pulse) -> None:
        """Add a thread."""
        self._seen[pulse] = (-1, 0)

    def start(self) -> None:
        """Begin to watch."""
        self._thread.start()

    def close(self) -> None:
        """Stop watching; a second call does nothing."""
        self._over.set()

    def look(self) -> tuple[str, float] | None:
        """Return the thread that stands still and for how long, in s; call it once in each turn."""
        for pulse, (n_before, n_turns) in tuple(self._seen.items()):
            stays = pulse.is_busy and pulse.n == n_before
            self._seen[pulse] = (pulse.n, n_turns + 1 if stays else 0)
            silent_s = self._seen[pulse][1] * self._turn_s
            if silent_s >= self._standstill_s:
                return pulse.who, silent_s
        return None

    def _watch(self) -> None:
        while not self._over.wait(self._turn_s):
            found = self.look()
            if found is not None:
                self._on_standstill(*found)
                return


Act = Callable[[], object]


class SerialExecutor:
    """Posted acts in order, and ``step`` every ``step_s`` between them, in a thread of its own.

    Whatever calls Zenoh may be called back by Zenoh in the same moment, in any thread. State that only this thread
    touches needs no lock, so no call to Zenoh can happen under one; and posting never waits, so no callback stops.
    ``on_error`` gets the exception of an act; it ends the thread.
    """

    def __init__(
        self, name: str, step: Callable[[], object], step_s: float, on_error: Callable[[BaseException], None]
    ):
        self.pulse: Final = Pulse(f"the thread '{name}'")
        self._step = step
        self._step_s = step_s
        self._on_error = on_error
        self._acts: queue.SimpleQueue[Act | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._perform, name=name, daemon=True)

    def start(self) -> None:
        """Begin with the acts that were posted so far."""
        self._thread.start()

    def post(self, act: Act) -> None:
        """Add an act; from any thread, and never waits."""
        self._acts.put(act)

    def close(self) -> None:
        """Perform what was posted before, then end; a second call does nothing."""
        self._acts.put(None)
        if self._thread.ident is not None:
            self._thread.join()

    def _perform(self) -> None:
        next_s = time.monotonic()
        while True:
            try:
                act = self._acts.get(timeout=max(0.0, next_s - time.monotonic()))
            except queue.Empty:
                act, next_s = self._step, time.monotonic() + self._step_s
            if act is None:
                return
            try:
                with self.pulse.busy():
                    act()
            except BaseException as error:
                self._on_error(error)
                return


class Deadline:
    """The end of the process ``patience_s`` after SIGINT, SIGTERM, SIGHUP or `begin`, unless the block ends before.

    A handler in Python runs in the main thread between two steps of the interpreter, so not while that thread waits
    within Zenoh. The signal's number therefore also reaches a pipe, from which a thread reads it.
    ``report`` gets the reason. The time begins anew while ``progress`` changes: a log that is being written is
    completed, however slow the disk is.
    """

    def __init__(
        self,
        report: Callable[[str], None],
        patience_s: float = _PATIENCE_S,
        leave: Callable[[int], object] = os._exit,
    ) -> None:
        self.progress: Callable[[], int] = int
        self._report = report
        self._patience_s = patience_s
        self._leave = leave
        self._over = threading.Event()
        self._receiving = -1
        self._ringing = -1

    @contextmanager
    def installed(self) -> Iterator[None]:
        """Hold for the block; enter it in the main thread, after the signals' handlers were set."""
        self._receiving, self._ringing = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
        before = signal.set_wakeup_fd(self._ringing, warn_on_full_buffer=False)
        thread = threading.Thread(target=self._wait, name="deadline", daemon=True)
        thread.start()
        try:
            yield
        finally:
            signal.set_wakeup_fd(before)
            self._over.set()
            thread.join()
            os.close(self._receiving)
            os.close(self._ringing)

    def begin(self) -> None:
        """Let the time begin now, without a signal; call it when the work is done and only closing is left."""
        os.write(self._ringing, bytes((signal.SIGTERM,)))

    def _wait(self) -> None:
        while not self._over.is_set():
            ready, _, _ = select.select((self._receiving,), (), (), _GLANCE_S)
            if ready and _ENDING.intersection(os.read(self._receiving, 64)):
                break
        seen, until_s = self.progress(), time.monotonic() + self._patience_s
        while not self._over.wait(_GLANCE_S):
            if (now := self.progress()) != seen:
                seen, until_s = now, time.monotonic() + self._patience_s
            if time.monotonic() > until_s:
                self._report(
                    f"does not end within {self._patience_s:g} s, because a call to Zenoh does not return: "
                    "the process ends without closing its sessions, and the log may lack its last records"
                )
                self._leave(PeerError.exit_code)
                return


def is_answered(session: zenoh.Session, timeout_s: float = _TIMEOUT_S) -> bool:
    """Tell whether the routers of a session answer within ``timeout_s``: a session without any answers itself."""
    ended, failed = threading.Event(), threading.Event()

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is None:
            failed.set()

    with suppress(zenoh.ZError):
        handler = zenoh.handlers.Callback(take, ended.set, indirect=False)
        session.liveliness().get(_UNUSED_KEY, handler, timeout=timeout_s)
        return ended.wait(2 * timeout_s) and not failed.is_set()
    return False


class Failing(Protocol):
    """The bridge, as far as needed here."""

    def failed(self, error: BaseException) -> None:
        """Keep the error, and end."""


def is_deadlocked(session: zenoh.Session, timeout_s: float = _TIMEOUT_S) -> bool:
    """Tell whether a session cannot declare anything within ``timeout_s``."""
    declared = threading.Event()

    def declare() -> None:
        with suppress(zenoh.ZError):  # a refusal is an answer too
            session.declare_querier(_UNUSED_KEY).undeclare()  # type: ignore[no-untyped-call]
        declared.set()

    threading.Thread(target=declare, name="deadlock", daemon=True).start()
    return not declared.wait(timeout_s)


def router_deadlock(network: str) -> Fault:
    """Return the fault of a router session that routes nothing any more."""
    rule = "netem's own session is deadlocked and routes nothing: restart netem, and do not read its admin space"
    return Fault("netem", f"the {network} network", rule)


def end_process(bridge: Failing, fault: Fault, report: Callable[[str], None]) -> None:
    """Report the reason, end the bridge, which closes its log, and 3 s later the process, whose sessions hang."""
    error = PeerError(fault)
    report(str(error.faults[0]))
    bridge.failed(error)

    def leave() -> None:
        time.sleep(_CLOSING_S)
        os._exit(error.exit_code)

    threading.Thread(target=leave, name="leave", daemon=True).start()
