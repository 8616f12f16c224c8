"""Logging off the hot path: the loop queues records, one thread writes them."""

import contextlib
import queue
import threading
import time
from collections.abc import Callable, Iterable
from typing import Final, Protocol

from common.node import Record
from common.runtime.inbox import lower_priority
from common.runtime.loop import Recorder
from common.units import NS_PER_S

FLUSH_EVERY_NS: Final = NS_PER_S // 2
_FLUSH_EVERY_S: Final = FLUSH_EVERY_NS / NS_PER_S


class Log(Recorder, Protocol):
    """Destination of records; called from one thread only."""

    def flush(self) -> None:
        """Write all records so far to disk."""

    def close(self) -> None:
        """Finish the log; a second call does nothing."""


class FileLog(Log, Protocol):
    """A log that also takes files."""

    def attach(self, name: str, data: bytes) -> None:
        """Add a file."""


class ThreadedRecorder:
    """Writes a log from a separate thread and flushes it twice a second.

    A failing disk does not stop the run: ``error`` holds the reason, later records are dropped and counted.
    """

    def __init__(self, log: Log) -> None:
        self.error: OSError | None = None
        self.n_dropped = 0
        self._log = log
        self._queue: queue.SimpleQueue[Record | Callable[[], Iterable[Record]] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._thread.start()

    def record(self, record: Record) -> None:
        """Queue one record; never blocks."""
        self._queue.put(record)

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        """Queue a function whose records the writing thread makes and logs."""
        self._queue.put(make)

    def close(self) -> None:
        """Write the queued records and close the log."""
        self._queue.put(None)
        self._thread.join()

    def _write(self) -> None:
        lower_priority()
        flushed_s = time.monotonic()
        while True:
            try:
                item = self._queue.get(timeout=_FLUSH_EVERY_S)
            except queue.Empty:
                self._guard(self._log.flush)
                flushed_s = time.monotonic()
                continue
            if item is None:
                break
            for record in (item,) if isinstance(item, Record) else item():
                self._guard(self._log.record, record)
            if time.monotonic() - flushed_s > _FLUSH_EVERY_S:
                self._guard(self._log.flush)
                flushed_s = time.monotonic()
        self._guard(self._log.close)

    def _guard(self, action, *arguments: Record) -> None:  # type: ignore[no-untyped-def]
        if self.error is not None:
            self.n_dropped += len(arguments)
            return
        try:
            action(*arguments)
        except OSError as error:
            self.error = error
            self.n_dropped += len(arguments)
            with contextlib.suppress(OSError):
                self._log.close()
