"""A watch over netem's threads: one that does not return from a call ends the process, with a reason.

Zenoh runs in netem's process. A call that waits for ever, for whatever lock, would leave a process that carries
nothing and cannot be stopped: two networks would look cut off for a reason that no log names.
"""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Final

_TURN_S: Final = 0.5
_STANDSTILL_S: Final = 8.0


class Pulse:
    """The life of one thread: busy or waiting, and a count that grows with all that it does."""

    __slots__ = ("is_busy", "n", "who")

    def __init__(self, who: str) -> None:
        self.who = who
        self.n = 0
        self.is_busy = False

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
