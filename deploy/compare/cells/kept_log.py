"""Logs of a cell: one in memory that keeps only the records that scores need, and one that keeps nothing."""

from typing import Final

from tis.common.channels import Side
from tis.common.node import Record
from tis.common.records import COUNTERS, ESTIMATES, FRESH, PLANT, TICKS, TRUTH
from tis.deploy.logs.read.memory import MemoryLog

_KEPT: Final = (COUNTERS, FRESH, PLANT, TICKS, TRUTH)


class KeptLog(MemoryLog):
    """Keeps estimates, truth, ticks and counters, and the first message of each key, which begins the scoring.

    With several copies of each sample the packets' records would be most of a run's memory.
    """

    def __init__(self, side: Side) -> None:
        super().__init__(side)
        self._begun: set[str] = set()

    def record(self, record: Record) -> None:
        """Keep or drop a record."""
        topic = record.topic
        is_message = not topic.startswith("/")
        if topic in _KEPT or topic.startswith(ESTIMATES) or (is_message and topic not in self._begun):
            super().record(record)
        if is_message:
            self._begun.add(topic)


class NoLog:
    """Keeps nothing, for cells whose results are no part of a log."""

    def record(self, record: Record) -> None:
        """Drop a record."""
