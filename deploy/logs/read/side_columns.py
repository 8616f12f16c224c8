"""One side's log in memory: rare records as rows, frequent ones as columns."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from tis.common.channels import Side
from tis.common.errors import DataError, Fault
from tis.common.records import FATES, RELEASES, Departure, FateBatch, Outcome, ReleaseBatch
from tis.deploy.logs.blocks import Block
from tis.deploy.logs.coverage import WHOLE, Coverage
from tis.deploy.logs.json_rows import UNREADABLE, Row, json_rows, other_version
from tis.deploy.logs.limits import MAX_CHANNELS
from tis.deploy.logs.read.clocks import RunClocks, aligned_rows, sender_of
from tis.deploy.logs.read.compact_ints import CompactInts, integers
from tis.deploy.logs.read.message_columns import MessageColumns
from tis.deploy.logs.read.rare_records import check_rows
from tis.deploy.logs.read.rows import Rows, column_model

Ints = NDArray[np.int64]

_CODES: Final[Mapping[str, Mapping[str, int]]] = {
    "outcome": {name: code for code, name in enumerate(get_args(Outcome))},
    "departure": {name: code for code, name in enumerate(get_args(Departure))},
}
_ALIKE: Final = ("direction", "key")
_COLUMNS: Final = {
    topic: tuple(name for name in model.model_fields if name not in (*_ALIKE, "foreign"))
    for topic, model in ((FATES, FateBatch), (RELEASES, ReleaseBatch))
}


@dataclass
class SideLog:
    """One side's log: its own records by topic, in order of writing, and messages by key.

    ``batches`` holds `FateBatch` and `ReleaseBatch` records by topic, merged into one per direction and key, with
    `CompactInts` as columns, ``foreign`` too.
    """

    side: Side
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    rows: dict[str, Rows | list[Row]]
    messages: dict[str, MessageColumns] = field(default_factory=dict)
    batches: dict[str, list[Row]] = field(default_factory=dict)
    last_ns: int = 0
    n_messages: int = 0
    coverage: Coverage = WHOLE
    """The gaps of a damaged or recovered log."""

    def add_message(self, key: str, payload: bytes, seq: int, sent_ns: int, log_ns: int) -> None:
        """Add a message that the side sent or received."""
        self._count(log_ns)
        if column_model(key) is not None:
            self._rows_of(key).append(from_json(payload))
            return
        self._messages_of(key).append(payload, seq, sent_ns, log_ns)

    def add(self, topic: str, row: Row, log_ns: int) -> None:
        """Add one of the side's own records; raises `DataError` for a batch of another version."""
        self._count(log_ns)
        if topic in _COLUMNS:
            self._add_batch(topic, row)
        else:
            self._rows_of(topic).append(row)

    def add_block(self, topic: str, block: Block, which: Ints) -> None:
        """Add a block's messages on a topic, by index; raises `DataError` as `add` does."""
        self.n_messages += len(which)
        self.last_ns = max(self.last_ns, int(block.log_ns[which].max(initial=0)))
        try:
            if not topic.startswith("/") and column_model(topic) is None:
                self._messages_of(topic).extend(block, which)
                return
            for rows in json_rows(block.payloads(which)):
                self._add_rows(topic, rows)
        except UNREADABLE:
            raise other_version(topic) from None

    def _add_rows(self, topic: str, rows: list[Row]) -> None:
        if topic in _COLUMNS:
            for row in rows:
                self._add_batch(topic, row)
            return
        known = self._rows_of(topic)
        if not isinstance(known, Rows):
            check_rows(topic, rows)
        known.extend(rows)

    def _add_batch(self, topic: str, row: Row) -> None:
        """Append a batch to those of its direction and key."""
        columns = _batch(topic, row)
        known = self.batches.setdefault(topic, [])
        alike = (batch for batch in known if all(batch[name] == row[name] for name in _ALIKE))
        whole = next(alike, None)
        if whole is None:
            if len(known) == MAX_CHANNELS:
                raise DataError(Fault(topic, "", f"must have at most {MAX_CHANNELS} keys"))
            whole = {name: row[name] for name in _ALIKE} | {name: CompactInts() for name in ("foreign", *columns)}
            known.append(whole)
        whole["foreign"].extend(np.full(len(columns["seq"]), row["foreign"], dtype=np.int64))
        for name, column in columns.items():
            whole[name].extend(column)

    def _count(self, log_ns: int) -> None:
        self.n_messages += 1
        if log_ns > self.last_ns:
            self.last_ns = log_ns

    def _messages_of(self, key: str) -> MessageColumns:
        columns = self.messages.get(key)
        if columns is None:
            columns = self.messages[key] = MessageColumns()
        return columns

    def _rows_of(self, topic: str) -> Rows | list[Row]:
        rows = self.rows.get(topic)
        if rows is None:
            model = column_model(topic)
            rows = self.rows[topic] = [] if model is None else Rows(model)
        return rows

    def aligned(self, clocks: RunClocks) -> "SideLog":
        """Return the log with every stamp on the reference clock."""
        own, surgeon = clocks.model(self.side), clocks.model("surgeon")
        messages = dict(self.messages)
        for key, columns in self.messages.items():
            sender = sender_of(key)
            if sender is not None:
                messages[key] = columns.aligned(own, clocks.model(sender), surgeon)
        rows = {topic: aligned_rows(topic, rows, own, surgeon) for topic, rows in self.rows.items()}
        last_ns = int(own.to_reference_ns(np.array([self.last_ns]))[0])
        return replace(self, rows=rows, messages=messages, last_ns=last_ns, coverage=self.coverage.aligned(own))

    def column(self, topic: str, name: str) -> NDArray[np.int64]:
        """Return an integer column of a topic, shape (N,)."""
        rows = self.rows.get(topic, ())
        return rows.column(name) if isinstance(rows, Rows) else np.array([row[name] for row in rows], dtype=np.int64)

    def of(self, topic: str) -> Sequence[Row]:
        """Return a topic's rows, empty when it does not occur."""
        return self.rows.get(topic, [])


def _batch(topic: str, row: Row) -> dict[str, Ints]:
    """Return a batch's columns as arrays."""
    try:
        columns = {name: _column(name, row[name]) for name in _COLUMNS[topic]}
        if not all(isinstance(row[name], str) for name in _ALIKE) or not isinstance(row["foreign"], bool):
            raise TypeError("a batch is of one direction and key")
    except UNREADABLE:
        raise other_version(topic) from None
    if len({len(column) for column in columns.values()}) > 1:
        raise DataError(Fault(topic, "", "holds a batch with columns of different lengths"))
    return columns


def _column(name: str, values: list[Any]) -> Ints:
    codes = _CODES.get(name)
    return integers(values if codes is None else [codes[value] for value in values])
