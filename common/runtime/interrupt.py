"""The signals that end a process cleanly: Ctrl-C, SIGTERM, and the loss of the terminal."""

import contextlib
import os
import signal
import stat
from collections.abc import Callable, Iterator
from typing import Any, Final

_ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_STANDARD_STREAMS: Final = (0, 1, 2)


class Interrupt:
    """SIGINT, SIGTERM and SIGHUP as a flag; ``wakers`` wake the waiting loops.

    SIGHUP, sent when a terminal or its ssh session ends, stays ignored where it is ignored already (``nohup``).
    """

    def __init__(self) -> None:
        self.requested = False
        self.wakers: list[Callable[[], None]] = []
        self._hung_up = False

    @contextlib.contextmanager
    def installed(self) -> Iterator[None]:
        """Handle the signals within the block."""
        handled = [number for number in _ENDING if signal.getsignal(number) is not signal.SIG_IGN]
        before = {number: signal.signal(number, self._note) for number in handled}
        try:
            yield
        finally:
            if self._hung_up:  # shell and kernel send one SIGHUP each; the second must not stop the clean-up
                before[signal.SIGHUP] = signal.SIG_IGN
            for number, handler in before.items():
                signal.signal(number, handler)

    def _note(self, number: int, frame: Any) -> None:  # noqa: ARG002
        if number == signal.SIGHUP:
            self._hung_up = True
            _detach_from_terminal()
        self.requested = True
        for wake in self.wakers:
            wake()


def _detach_from_terminal() -> None:
    """Redirect the standard streams of a lost terminal to the null device, since each write would fail."""
    for number in _STANDARD_STREAMS:
        with contextlib.suppress(OSError):
            if stat.S_ISCHR(os.fstat(number).st_mode) and not os.isatty(number):
                null = os.open(os.devnull, os.O_RDWR)
                os.dup2(null, number)
                os.close(null)
