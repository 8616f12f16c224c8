"""Server of the reference clock.

netem's answers directly on each network, outside its links; that of a probe's far end answers along the probe's path.
"""

import contextlib
import json
import queue
import threading
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Final, Self

import zenoh

from tis.common.runtime.clock import boot_id, monotonic_ns

_MAX_PENDING: Final = 256


class ClockServer:
    """Answers clock queries with the instants at which each was received and replied to.

    The callback only stamps; a separate thread replies, and its delay cancels out between the two stamps. Queries
    beyond the queue's length are not answered.
    """

    def __init__(self, sessions: Iterable[zenoh.Session], key: str) -> None:
        self._key = key
        self._boot_id = boot_id()
        self._pending: queue.Queue[tuple[int, zenoh.Query] | None] = queue.Queue(_MAX_PENDING)
        self._thread = threading.Thread(target=self._serve, name="clock", daemon=True)
        self._held: list[Any] = [
            session.declare_queryable(self._key, zenoh.handlers.Callback(self._take, indirect=False), complete=True)
            for session in sessions
        ]
        self._thread.start()

    def close(self) -> None:
        """Stop answering; a second call does nothing."""
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()
        if self._thread.is_alive():
            self._pending.put(None)
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
            self._pending.put_nowait((received_ns, query))

    def _serve(self) -> None:
        while (pending := self._pending.get()) is not None:
            received_ns, query = pending
            with contextlib.suppress(zenoh.ZError), query:  # the client may be gone
                reading = {"boot_id": self._boot_id, "received_ns": received_ns, "replied_ns": monotonic_ns()}
                query.reply(self._key, json.dumps(reading), express=True)
