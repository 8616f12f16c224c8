"""The logs of a run as columns."""

from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from common.channels import Direction, Side, direction_of
from common.errors import DataError
from common.runtime.playback import LogReader

Row = dict[str, Any]


@dataclass
class SideLog:
    """One side's log: its own records by topic, in the order they were written."""

    side: Side
    damage: str | None
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    rows: dict[str, list[Row]]
    last_ns: int = 0
    n_messages: int = 0

    def column(self, topic: str, name: str) -> NDArray[np.int64]:
        """Return an integer column of a topic, shape (N,)."""
        return np.array([row[name] for row in self.rows.get(topic, ())], dtype=np.int64)

    def of(self, topic: str) -> list[Row]:
        """Return a topic's rows, none when it does not occur."""
        return self.rows.get(topic, [])


@dataclass
class RunLogs:
    """The logs that a run folder holds, by side."""

    run_dir: Path
    sides: dict[Side, SideLog] = field(default_factory=dict)

    def of(self, side: Side, topic: str) -> list[Row]:
        """Return a side's rows of a topic; none when the log is missing."""
        log = self.sides.get(side)
        return [] if log is None else log.of(topic)

    def messages(self, side: Side, direction: Direction, session: str) -> list[tuple[str, Row]]:
        """Return a side's messages that go in ``direction``, each with its key, key by key."""
        log = self.sides.get(side)
        topics = [] if log is None else [key for key in log.rows if direction_of(key, session) == direction]
        return [(key, row) for key in topics for row in self.of(side, key)]

    def problems(self) -> list[str]:
        """Return what is missing or damaged."""
        found = [f"{side}: log is missing" for side in get_args(Side) if side not in self.sides]
        found += [f"{side}: log is damaged ({log.damage})" for side, log in self.sides.items() if log.damage]
        return found


def load_side(path: Path, side: Side) -> SideLog:
    """Read one log: the testbed's own records by topic, and the messages that it sent and received by key.

    A message's row has its payload and, as ``_seq``, ``_sent_ns`` and ``_log_ns``, its number, when it was sent, and
    when it was sent or received here. A damaged log gives what can be read of it. Raises `DataError` when the file
    is no log.
    """
    reader = LogReader(path)
    rows: dict[str, list[Row]] = defaultdict(list)
    log = SideLog(side, None, reader.metadata, reader.attachments, rows)
    for topic, message in reader.messages():
        log.n_messages += 1
        log.last_ns = max(log.last_ns, message.log_time)
        row = from_json(message.data)
        if not topic.startswith("/"):
            row["_seq"], row["_sent_ns"], row["_log_ns"] = message.sequence, message.publish_time, message.log_time
        rows[topic].append(row)
    log.damage, log.metadata = reader.damage, reader.metadata
    return log


def load_run(run_dir: Path) -> RunLogs:
    """Read the logs of a run folder, those that are there; a file that cannot be read as a log counts as damaged.

    A side that is killed before its log's first flush leaves an empty file.
    """
    logs = RunLogs(run_dir)
    for side in get_args(Side):
        path = run_dir / f"{side}.mcap"
        if path.is_file():
            try:
                logs.sides[side] = load_side(path, side)
            except DataError as error:
                logs.sides[side] = SideLog(side, error.faults[0].rule, {}, {}, {})
    return logs
