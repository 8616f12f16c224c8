"""Logging off the hot path: the loop queues records, one thread looks for them and writes them.

``TIS_RECORD=ticks`` in the environment of a side's process, a test instrument for the cost of recording, replaces the
recorder by one that keeps this side's ticks and drops everything else. During the run nothing is written and there is
no writing thread; at the end the ticks are written, which show the side's punctuality. It serves `tis bench
recording`; the log does not describe a run.
"""

import contextlib
import os
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable
from typing import Final, Protocol

from msgspec.structs import astuple

from tis.common.messages import Message
from tis.common.node import Record
from tis.common.records import COUNTERS, TICKS, UNRECORDED, CounterNote
from tis.common.runtime.loop import Recorder
from tis.common.runtime.memory import LevelHeap
from tis.common.runtime.scheduling import stand_behind
from tis.common.topics import topic_of
from tis.common.units import NS_PER_S

FLUSH_EVERY_NS: Final = NS_PER_S // 2
_FLUSH_EVERY_S: Final = FLUSH_EVERY_NS / NS_PER_S
MAX_WAITING_BYTES: Final = 64 << 20
_SOFT_BYTES: Final = 8 << 20
"""Nearly half a second at 1 kHz with two hands, minutes at 30 Hz."""
_MODEL_BYTES: Final = 750
"""Memory of a record that is still a model: an `OrientationNote`, the largest frequent one (tracemalloc: 713)."""
_RECORD_BYTES: Final = 300
"""Memory of a record around its payload's bytes (tracemalloc: 561 with one of 300)."""
_ROW_BYTES: Final = 400
"""Memory of a packet in a batch that is still to be made: a tuple of eight integers."""
_LOOK_EVERY_S: Final = 0.02
"""A loop that woke the thread for each record would change between them thousands of times a second."""
_FIRST_BATCH_BYTES: Final = 40_000
_URGENT_S: Final = 0.2
_URGENT_BYTES: Final = 1 << 20
"""About a twentieth of a second at 1 kHz with two hands."""
_EASY_S: Final = 0.05
_N_COLUMNS: Final = 8
_Item = Record | Callable[[], Iterable[Record]]


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

    A failing disk does not stop the run: ``error`` holds the reason, later records are dropped and counted, and
    ``on_error`` is called at once. Records that wait take at most ``max_bytes``. From ``soft_bytes`` on what a replay
    computes again (estimates, set points, the plant) is dropped; at the limit everything is. The counters of the log
    say what is missing, by topic.
    """

    def __init__(
        self,
        log: Log,
        on_error: Callable[[OSError], None] = lambda _: None,
        max_bytes: int = MAX_WAITING_BYTES,
        soft_bytes: int = _SOFT_BYTES,
    ) -> None:
        self.error: OSError | None = None
        self.n_dropped = 0
        self.unrecorded: Counter[str] = Counter()
        self._log = log
        self._on_error = on_error
        self._max_bytes, self._soft_bytes = max_bytes, soft_bytes
        self._n_put = 0  # a sum that two threads may rarely garble by one record: it only bounds the memory
        self._n_taken = 0
        self._emptied_s = time.monotonic()  # when the thread last found nothing more to write
        self._is_behind = True
        self._last_ns = 0
        self._batch_bytes = _FIRST_BATCH_BYTES  # the size of a batch is known when it is made: the largest so far
        self._queue: deque[tuple[int, _Item]] = deque()
        self._closing = threading.Event()
        self._flushed_s, self._heap = time.monotonic(), LevelHeap()
        self._thread = threading.Thread(target=self._write, name="recorder", daemon=True)
        self._thread.start()

    @property
    def waiting_bytes(self) -> int:
        """Return about how much memory the records take that are not written yet."""
        return self._n_put - self._n_taken

    @property
    def lag_s(self) -> float:
        """Return how long ago the thread last found nothing more to write, in s; 0 where none waits."""
        return time.monotonic() - self._emptied_s if self.waiting_bytes else 0.0

    def keep_up(self) -> None:
        """Let the writing thread take turns with the loops while it lags, and else stand behind them.

        A log that is not written is worse than ticks that are missed. To be called several times a second.
        """
        lag_s = self.lag_s
        if self._is_behind and lag_s > _URGENT_S:
            self._stand(behind=False)
        elif not self._is_behind and lag_s < _EASY_S:
            self._stand(behind=True)

    def _stand(self, behind: bool) -> None:
        self._is_behind = behind
        stand_behind(self._thread.native_id or 0, behind)

    def record(self, record: Record) -> None:
        """Queue one record; never blocks."""
        data = record.data
        n_bytes = _RECORD_BYTES + len(data) if isinstance(data, bytes) else _MODEL_BYTES
        waiting = self._n_put - self._n_taken
        if waiting > _URGENT_BYTES and self._is_behind:
            self._stand(behind=False)
        if waiting > self._soft_bytes and (waiting + n_bytes > self._max_bytes or is_recomputable(record.topic)):
            self.unrecorded[record.topic] += 1
            return
        self._n_put += n_bytes
        self._queue.append((n_bytes, record))

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        """Queue a function whose records the writing thread makes and logs."""
        n_bytes = self._batch_bytes
        if self._n_put - self._n_taken + n_bytes > self._max_bytes:
            self.unrecorded["batches"] += 1
            return
        self._n_put += n_bytes
        self._queue.append((n_bytes, make))

    def close(self) -> None:
        """Write the queued records, what is missing, and close the log."""
        self._closing.set()
        self._thread.join()

    def _write(self) -> None:
        stand_behind(0, behind=True)
        is_last = False
        while not is_last:
            is_last = self._closing.wait(_LOOK_EVERY_S)  # first: whatever was queued before is found below
            self._write_waiting()
            self._emptied_s = time.monotonic()
            self._flush_in_time()
        for topic, n in sorted(self.unrecorded.items()):
            note = CounterNote(name=f"{UNRECORDED}.{topic}", value=n)
            self._guard(self._log.record, Record(COUNTERS, self._last_ns, note))
        self._guard(self._log.close)

    def _write_waiting(self) -> None:
        while self._queue:
            n_bytes, what = self._queue.popleft()
            # A function makes its records here, off the loop's thread.
            for record in (what,) if isinstance(what, Record) else self._made(what):
                self._guard(self._log.record, record)
                self._last_ns = record.log_ns
            self._n_taken += n_bytes
            self._flush_in_time()

    def _flush_in_time(self) -> None:
        now_s = time.monotonic()
        if now_s - self._flushed_s > _FLUSH_EVERY_S:
            self._guard(self._log.flush)
            self._flushed_s = now_s
            self._heap.look(now_s)

    def _made(self, make: Callable[[], Iterable[Record]]) -> list[Record]:
        """Return the records of a batch, and remember how large it is."""
        records = list(make())
        columns = (
            column for record in records if isinstance(record.data, Message) for column in astuple(record.data)
        )
        n_rows = sum(len(column) for column in columns if isinstance(column, tuple)) // _N_COLUMNS
        self._batch_bytes = max(self._batch_bytes, _ROW_BYTES * n_rows)
        return records

    def _guard(self, action, *arguments: Record) -> None:  # type: ignore[no-untyped-def]
        # The first failure closes the log; whatever follows is dropped and counted.
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
            self._on_error(error)
        except (TypeError, ValueError):  # one record that no JSON holds is lacking, and the others are written
            if not arguments:
                raise
            self.unrecorded.update(record.topic for record in arguments)


def is_recomputable(topic: str) -> bool:
    """Tell whether a replay of the arrivals computes the records of a topic again."""
    declared = topic_of(topic)
    return declared is not None and declared.is_recomputable


RECORD_VARIABLE: Final = "TIS_RECORD"
TICKS_ONLY: Final = "ticks"


class TicksOnly:
    """Same interface as `ThreadedRecorder`; ``n_dropped`` counts dropped records, a batch as one."""

    waiting_bytes = 0

    def __init__(self, log: Log) -> None:
        self.error: OSError | None = None
        self.n_dropped = 0
        self._log = log
        self.unrecorded: dict[str, int] = {}
        self._kept: list[Record] = []

    def record(self, record: Record) -> None:
        """Keep a tick in memory, drop anything else."""
        if record.topic == TICKS:
            self._kept.append(record)
        else:
            self.n_dropped += 1

    def record_later(self, _: Callable[[], Iterable[Record]]) -> None:
        """Drop the records."""
        self.n_dropped += 1

    def keep_up(self) -> None:
        """Do nothing: there is no writing thread."""

    def close(self) -> None:
        """Write the ticks and close the log."""
        try:
            for record in self._kept:
                self._log.record(record)
            self._log.close()
        except OSError as error:
            self.error = error


def recorder_for(log: Log, on_error: Callable[[OSError], None]) -> ThreadedRecorder | TicksOnly:
    """Return the recorder of a log: the complete one, unless the environment requests ticks only."""
    return TicksOnly(log) if os.environ.get(RECORD_VARIABLE) == TICKS_ONLY else ThreadedRecorder(log, on_error)
