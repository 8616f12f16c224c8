"""A serial executor: one thread that performs acts in the order in which they were posted.

Whatever calls Zenoh may be called back by Zenoh in the same moment, in any thread. State that only this thread
touches needs no lock, so no call to Zenoh can happen under one; and posting never waits, so no callback stops.
"""

import queue
import threading
import time
from collections.abc import Callable
from typing import Final

from tis.netem.bridge.standstill import Pulse

Act = Callable[[], object]


class SerialExecutor:
    """Posted acts, and ``step`` every ``step_s`` between them, in a thread of its own.

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
