"""A deadline for the end of the process: after a signal it ends, even if a call to Zenoh never returns.

A handler in Python runs in the main thread between two steps of the interpreter, so not while that thread waits
within Zenoh. The signal's number therefore also reaches a pipe, from which a thread reads it.
"""

import os
import select
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

from tis.common.errors import PeerError

_PATIENCE_S: Final = 6.0
_TURN_S: Final = 0.1
_ENDING: Final = frozenset((signal.SIGINT, signal.SIGTERM, signal.SIGHUP))


class Deadline:
    """Ends the process ``patience_s`` after SIGINT, SIGTERM, SIGHUP or `begin`, unless the block ends before.

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
            ready, _, _ = select.select((self._receiving,), (), (), _TURN_S)
            if ready and _ENDING.intersection(os.read(self._receiving, 64)):
                break
        seen, until_s = self.progress(), time.monotonic() + self._patience_s
        while not self._over.wait(_TURN_S):
            if (now := self.progress()) != seen:
                seen, until_s = now, time.monotonic() + self._patience_s
            if time.monotonic() > until_s:
                self._report(
                    f"does not end within {self._patience_s:g} s, because a call to Zenoh does not return: "
                    "the process ends without closing its sessions, and the log may lack its last records"
                )
                self._leave(PeerError.exit_code)
                return
