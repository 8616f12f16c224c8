"""Test instrument for the cost of recording: a recorder that keeps this side's ticks and drops everything else.

``TIS_RECORD=ticks`` in the environment of a side's process replaces the recorder by it. During the run nothing is
written and there is no writing thread; at the end the ticks are written, which show the side's punctuality. It serves
`tis bench recording`; the log does not describe a run.
"""

import os
from collections.abc import Callable, Iterable
from typing import Final

from tis.common.node import Record
from tis.common.records import TICKS
from tis.common.runtime.recorder import Log, ThreadedRecorder

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
