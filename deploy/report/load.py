"""The logs of a run: own records as rows, what comes by the million as columns."""

from array import array
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from common.channels import Direction, Side, direction_of
from common.errors import DataError, Fault
from common.records import FATES, RELEASES, Departure, FateBatch, Outcome, ReleaseBatch
from common.runtime.playback import LogReader

Row = dict[str, Any]
Ints = NDArray[np.int64]

NO_INSTANT: Final = -1
_CODES: Final[Mapping[str, Mapping[str, int]]] = {
    "outcome": {name: code for code, name in enumerate(get_args(Outcome))},
    "departure": {name: code for code, name in enumerate(get_args(Departure))},
}
_COLUMNS: Final = {
    topic: tuple(name for name in model.model_fields if name not in ("direction", "key", "foreign"))
    for topic, model in ((FATES, FateBatch), (RELEASES, ReleaseBatch))
}


class MessageColumns:
    """The messages of one key that a side sent or received, in the order of its log."""

    def __init__(self) -> None:
        self._seq, self._sent, self._log, self._sample, self._command = (array("q") for _ in range(5))

    def append(self, payload: Row, seq: int, sent_ns: int, log_ns: int) -> None:
        """Add a message; of its payload only the instants are kept."""
        sample_ns, command_ns = payload.get("sample_ns"), payload.get("command_sample_ns")
        self._seq.append(seq)
        self._sent.append(sent_ns)
        self._log.append(log_ns)
        self._sample.append(NO_INSTANT if sample_ns is None else sample_ns)
        self._command.append(NO_INSTANT if command_ns is None else command_ns)

    def __len__(self) -> int:
        return len(self._seq)

    @property
    def seq(self) -> Ints:
        """Return the sequence numbers, (N,)."""
        return np.array(self._seq, dtype=np.int64)

    @property
    def sent_ns(self) -> Ints:
        """Return when each was sent, (N,)."""
        return np.array(self._sent, dtype=np.int64)

    @property
    def log_ns(self) -> Ints:
        """Return when each was sent or received here, (N,)."""
        return np.array(self._log, dtype=np.int64)

    @property
    def sample_ns(self) -> Ints:
        """Return the sample instants, (N,)."""
        return np.array(self._sample, dtype=np.int64)

    @property
    def command_sample_ns(self) -> Ints:
        """Return the sample instant of the command that each answers, (N,); `NO_INSTANT` where there is none."""
        return np.array(self._command, dtype=np.int64)


@dataclass
class SideLog:
    """One side's log: its own records by topic, in the order they were written, and the messages by key.

    ``batches`` holds `FateBatch` and `ReleaseBatch` records, by topic: rows whose columns are arrays.
    """

    side: Side
    damage: str | None
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    rows: dict[str, list[Row]]
    messages: dict[str, MessageColumns] = field(default_factory=dict)
    batches: dict[str, list[Row]] = field(default_factory=dict)
    last_ns: int = 0
    n_messages: int = 0

    def add(self, topic: str, row: Row, seq: int, sent_ns: int, log_ns: int) -> None:
        """Add what was recorded on a topic; raises `DataError` when a batch is not of this version."""
        self.n_messages += 1
        if log_ns > self.last_ns:
            self.last_ns = log_ns
        if not topic.startswith("/"):
            columns = self.messages.get(topic)
            if columns is None:
                columns = self.messages[topic] = MessageColumns()
            columns.append(row, seq, sent_ns, log_ns)
        elif topic in _COLUMNS:
            self.batches.setdefault(topic, []).append(_batch(topic, row))
        else:
            self.rows.setdefault(topic, []).append(row)

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

    def attachments(self, side: Side) -> dict[str, bytes]:
        """Return the files attached to a side's log; none when the log is missing."""
        log = self.sides.get(side)
        return {} if log is None else log.attachments

    def messages(self, side: Side, direction: Direction, session: str) -> dict[str, MessageColumns]:
        """Return a side's messages that go in ``direction``, by key."""
        log = self.sides.get(side)
        known = {} if log is None else log.messages
        return {key: columns for key, columns in known.items() if direction_of(key, session) == direction}

    def problems(self) -> list[str]:
        """Return what is missing or damaged."""
        found = [f"{side}: log is missing" for side in get_args(Side) if side not in self.sides]
        found += [f"{side}: log is damaged ({log.damage})" for side, log in self.sides.items() if log.damage]
        return found


def load_side(path: Path, side: Side) -> SideLog:
    """Read one log: the testbed's own records by topic, and the messages that it sent and received by key.

    A damaged log gives what can be read of it. Raises `DataError` when the file is no log, or none of this version.
    """
    reader = LogReader(path)
    log = SideLog(side, None, reader.metadata, reader.attachments, defaultdict(list))
    for topic, message in reader.messages():
        log.add(topic, from_json(message.data), message.sequence, message.publish_time, message.log_time)
    log.damage, log.metadata = reader.damage, reader.metadata
    return log


def _batch(topic: str, row: Row) -> Row:
    """Return a batch with its columns as arrays."""
    try:
        columns = {name: _column(name, row[name]) for name in _COLUMNS[topic]}
    except (LookupError, TypeError, ValueError, OverflowError):
        raise DataError(Fault(topic, "", "holds records that this version does not know")) from None
    if len({len(column) for column in columns.values()}) > 1:
        raise DataError(Fault(topic, "", "holds a batch with columns of different lengths"))
    return {**row, **columns}


def _column(name: str, values: list[Any]) -> Ints:
    codes = _CODES.get(name)
    if codes is None:
        return np.array(values, dtype=np.int64)
    return np.fromiter(map(codes.__getitem__, values), dtype=np.int64, count=len(values))


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
