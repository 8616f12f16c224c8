"""An instrument to measure what recording costs: a recorder that keeps this side's ticks and drops all else.

``TIS_RECORD=ticks`` in the environment of a side's process sets it in the place of the recorder. Nothing is written
while the run lasts, and no thread is there to write; at the end the ticks go into the log, so that one can tell how
punctual the side was. `tis bench recording` uses it. Such a log is no record of a run.
"""

import os
from collections.abc import Callable, Iterable
from typing import Final

from common.node import Record
from common.records import TICKS
from common.runtime.recorder import Log, ThreadedRecorder

RECORD_VARIABLE: Final = "TIS_RECORD"
TICKS_ONLY: Final = "ticks"


class TicksOnly:
    """Takes what `ThreadedRecorder` takes; ``n_dropped`` counts the records that were dropped, batches as one."""

    def __init__(self, log: Log) -> None:
        self.error: OSError | None = None
        self.n_dropped = 0
        self._log = log
        self._kept: list[Record] = []

    def record(self, record: Record) -> None:
        """Keep a tick in memory, drop anything else."""
        if record.topic == TICKS:
            self._kept.append(record)
        else:
            self.n_dropped += 1

    def record_later(self, _: Callable[[], Iterable[Record]]) -> None:
        """Drop what would have been made."""
        self.n_dropped += 1

    def close(self) -> None:
        """Write the ticks and close the log."""
        try:
            for record in self._kept:
                self._log.record(record)
            self._log.close()
        except OSError as error:
            self.error = error


def recorder_for(log: Log) -> ThreadedRecorder | TicksOnly:
    """Return what records into a log: all of it, unless the environment says otherwise."""
    return TicksOnly(log) if os.environ.get(RECORD_VARIABLE) == TICKS_ONLY else ThreadedRecorder(log)
