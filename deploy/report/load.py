"""The logs of a run as columns."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from common.channels import Side
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

    def problems(self) -> list[str]:
        """Return what is missing or damaged."""
        found = [f"{side}: log is missing" for side in get_args(Side) if side not in self.sides]
        found += [f"{side}: log is damaged ({log.damage})" for side, log in self.sides.items() if log.damage]
        return found


def load_side(path: Path, side: Side, suffixes: Sequence[str] = ("estimated_cp",)) -> SideLog:
    """Read one log: the testbed's own topics, and the messages whose key ends in one of ``suffixes``.

    Messages carry their stamps as ``_log_ns`` and ``_seq``. A damaged log gives what can be read of it.
    Raises `DataError` when the file is no log.
    """
    reader = LogReader(path)
    rows: dict[str, list[Row]] = defaultdict(list)
    log = SideLog(side, None, reader.metadata, reader.attachments, rows)
    for topic, message in reader.messages():
        log.n_messages += 1
        log.last_ns = max(log.last_ns, message.log_time)
        if topic.startswith("tis/") and not topic.endswith("_cp"):
            rows[topic].append(from_json(message.data))
        elif topic.endswith(tuple(suffixes)):
            row = from_json(message.data)
            row["_log_ns"], row["_seq"] = message.log_time, message.sequence
            rows[topic].append(row)
    log.damage, log.metadata = reader.damage, reader.metadata
    return log


def load_run(run_dir: Path) -> RunLogs:
    """Read the logs of a run folder, those that are there."""
    logs = RunLogs(run_dir)
    for side in get_args(Side):
        path = run_dir / f"{side}.mcap"
        if path.is_file():
            logs.sides[side] = load_side(path, side)
    return logs
