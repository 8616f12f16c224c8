"""The reference clock: what it shows to whoever asks.

netem's answers directly on each network, never through a link; that of a probe's far end where the probe's path goes.
"""

import contextlib
import json
import queue
import threading
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Final, Self

import zenoh

from common.runtime.clock import boot_id, monotonic_ns

_MOST_WAITING: Final = 256


class ClockServer:
    """Answers clock queries with when each was received and when it was replied to.

    The callback only stamps; the answer, whose making does not count as a way, comes from a thread of its own. Of a
    flood what does not fit is not answered.
    """

    def __init__(self, sessions: Iterable[zenoh.Session], key: str) -> None:
        self._key = key
        self._boot_id = boot_id()
        self._asked: queue.Queue[tuple[int, zenoh.Query] | None] = queue.Queue(_MOST_WAITING)
        self._thread = threading.Thread(target=self._serve, name="clock", daemon=True)
        self._held: list[Any] = [
            session.declare_queryable(self._key, zenoh.handlers.Callback(self._take, indirect=False), complete=True)
            for session in sessions
        ]
        self._thread.start()

    def close(self) -> None:
        """Answer no more; a second call does nothing."""
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()
        if self._thread.is_alive():
            self._asked.put(None)
            self._thread.join()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _take(self, query: zenoh.Query) -> None:
        received_ns = monotonic_ns()
        with contextlib.suppress(queue.Full):
            self._asked.put_nowait((received_ns, query))

    def _serve(self) -> None:
        while (asked := self._asked.get()) is not None:
            received_ns, query = asked
            with contextlib.suppress(zenoh.ZError), query:  # who asked may be gone
                reading = {"boot_id": self._boot_id, "received_ns": received_ns, "replied_ns": monotonic_ns()}
                query.reply(self._key, json.dumps(reading), express=True)
