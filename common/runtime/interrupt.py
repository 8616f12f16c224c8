"""The signals that end a process in order: Ctrl-C, SIGTERM, and a terminal that goes away."""

import contextlib
import os
import signal
import stat
from collections.abc import Callable, Iterator
from typing import Any, Final

_ENDING: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_STANDARD_STREAMS: Final = (0, 1, 2)


class Interrupt:
    """SIGINT, SIGTERM and SIGHUP as a flag; the waiting loops are woken through ``wakers``.

    SIGHUP, which comes when a terminal or its ssh goes away, stays ignored where it is (``nohup``).
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
            if self._hung_up:  # a shell and the kernel send one each, and the folder has yet to be completed
                before[signal.SIGHUP] = signal.SIG_IGN
            for number, handler in before.items():
                signal.signal(number, handler)

    def _note(self, number: int, frame: Any) -> None:  # noqa: ARG002
        if number == signal.SIGHUP:
            self._hung_up = True
            _let_go_of_the_terminal()
        self.requested = True
        for wake in self.wakers:
            wake()


def _let_go_of_the_terminal() -> None:
    """Write nowhere from now on in place of a terminal that is gone, where each write would fail."""
    for number in _STANDARD_STREAMS:
        with contextlib.suppress(OSError):
            if stat.S_ISCHR(os.fstat(number).st_mode) and not os.isatty(number):
                nowhere = os.open(os.devnull, os.O_RDWR)
                os.dup2(nowhere, number)
                os.close(nowhere)
