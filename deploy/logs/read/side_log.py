"""One side's log in memory: its own records by topic, messages by key, and netem's packets by direction and key."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from hashlib import blake2b
from typing import Any, Final, get_args

import numpy as np
from msgspec import convert
from numpy.typing import DTypeLike, NDArray

from tis.common.channels import Direction, Side
from tis.common.errors import DataError, Fault
from tis.common.messages import Message, as_row
from tis.common.node import Record
from tis.common.records import FATES, RELEASES, Departure, Outcome
from tis.common.runtime.chunk_writer import MESSAGE_HEAD_BYTES
from tis.common.sight_records import PICTURES
from tis.common.topic import Topic
from tis.common.topics import topic_of
from tis.deploy.logs.blocks import MAX_CHANNELS, Block
from tis.deploy.logs.coverage import WHOLE, Coverage
from tis.deploy.logs.payloads import (
    NO_INSTANT,
    UNREADABLE,
    Row,
    checked_number,
    json_rows,
    other_version,
    payload_instants,
)
from tis.deploy.logs.read.clocks import RunClocks, aligned_rows, sender_of
from tis.deploy.logs.read.columns import IntColumn, Ints, integers
from tis.deploy.logs.read.frame import Frame

OUTCOMES: Final[tuple[Outcome, ...]] = get_args(Outcome)
DEPARTURES: Final[tuple[Departure, ...]] = get_args(Departure)

_CODES: Final[Mapping[str, Mapping[str, int]]] = {
    "outcome": {name: code for code, name in enumerate(OUTCOMES)},
    "departure": {name: code for code, name in enumerate(DEPARTURES)},
}
_SMALL: Final = ("outcome", "departure", "copies", "copy_index", "flipped", "recovered")
"""Columns kept as int8, as millions of packets are in memory at a time."""

_RARE: Final = ("recovered", "recovered_ns")
"""Columns that are empty where all are 0; logs of older versions lack them."""

PACKETS: Final[Mapping[str, Mapping[str, DTypeLike]]] = {
    topic: {
        name: np.bool_ if name == "foreign" else np.int8 if name in _SMALL else np.int64
        for name in topic.fields
        if name not in ("direction", "key")
    }
    for topic in (FATES, RELEASES)
}
"""Columns of netem's packets, by topic of their batches: those of the model, a number for each text."""

MESSAGES: Final = ("seq", "sent_ns", "log_ns", "sample_ns", "command_sample_ns", "fingerprint")
"""Columns of messages: sequence number, instants of sending, of sending or receiving on this side, of the sample and
of the sample of the command that is answered (`NO_INSTANT` for none), and a hash of the payload: equal payloads have
equal ones, others never in practice."""

_WAITING: Final = 1024


def no_messages() -> Frame:
    """Return a frame of `MESSAGES` without any."""
    return Frame({name: IntColumn() for name in MESSAGES})


def no_packets(topic: str) -> Frame:
    """Return a frame of a topic's `PACKETS` without any."""
    return Frame({name: IntColumn(dtype) for name, dtype in PACKETS[topic].items()})


Packets = dict[str, dict[tuple[Direction, str], Frame]]
"""Packets by topic, direction and key."""


@dataclass
class SideLog:
    """One side's log: its own records by topic, in order of writing, messages by key, and netem's packets.

    ``packets`` are the batches of `FATES` and `RELEASES`, a frame for each direction and key.
    """

    side: Side
    metadata: dict[str, str] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    rows: dict[str, Frame] = field(default_factory=dict)
    messages: dict[str, Frame] = field(default_factory=dict)
    packets: Packets = field(default_factory=dict)
    last_ns: int = 0
    n_messages: int = 0
    coverage: Coverage = WHOLE
    """The gaps of a damaged or recovered log."""
    beside: tuple[Coverage, ...] = ()
    """The gaps of the logs of what ran beside the side: camera or screen."""

    def add_block(self, key: str, block: Block, which: Ints) -> None:
        """Add a block's messages under a topic or a key, by index; raises `DataError` for another version's."""
        self.n_messages += len(which)
        self.last_ns = max(self.last_ns, int(block.log_ns[which].max(initial=0)))
        topic = topic_of(key)
        try:
            if topic is None and not key.startswith("/"):
                self._add_messages(key, block, which)
                return
            for rows in json_rows(block.payloads(which)):
                if topic is None or not topic.is_frequent:
                    check_rows(topic, rows)
                self.add_rows(key, rows)
        except UNREADABLE:
            raise other_version(key) from None

    def add_rows(self, key: str, rows: Sequence[Row]) -> None:
        """Add the side's own records; raises `DataError` for a batch of another version, else one of `UNREADABLE`."""
        if key in PACKETS:
            for row in rows:
                self._add_batch(key, row)
            return
        known = self.rows.get(key)
        if known is None:
            known = self.rows[key] = Frame.of(topic_of(key))
        known.extend(rows)

    def _add_messages(self, key: str, block: Block, which: Ints) -> None:
        sample_ns, command_ns = payload_instants(block, which)
        hashes = np.fromiter(map(_fingerprint, block.payloads(which)), np.int64, len(which))
        columns = (block.seq[which], block.publish_ns[which], block.log_ns[which], sample_ns, command_ns, hashes)
        self.messages.setdefault(key, no_messages()).extend_columns(**dict(zip(MESSAGES, columns, strict=True)))

    def _add_batch(self, topic: str, row: Row) -> None:
        columns = _batch(topic, row)
        known = self.packets.setdefault(topic, {})
        place = row["direction"], row["key"]
        if place not in known:
            if len(known) == MAX_CHANNELS:
                raise DataError(Fault(topic, "", f"must have at most {MAX_CHANNELS} keys"))
            known[place] = no_packets(topic)
        known[place].extend_columns(**columns)

    def aligned(self, clocks: RunClocks) -> "SideLog":
        """Return the log with every stamp on the reference clock."""
        own, surgeon = clocks.model(self.side), clocks.model("surgeon")
        messages = dict(self.messages)
        for key, frame in self.messages.items():
            sender = sender_of(key)
            if sender is not None:
                sent = clocks.model(sender)
                by = {"log_ns": own, "sent_ns": sent, "sample_ns": sent, "command_sample_ns": surgeon}
                messages[key] = frame.with_columns(
                    **{
                        name: np.where((ns := frame.column(name)) == NO_INSTANT, ns, clock.to_reference_ns(ns))
                        for name, clock in by.items()
                        if not clock.shared
                    }
                )
        rows = {key: aligned_rows(topic_of(key), frame, own, surgeon) for key, frame in self.rows.items()}
        last_ns = int(own.to_reference_ns(np.array([self.last_ns]))[0])
        return replace(self, rows=rows, messages=messages, last_ns=last_ns, coverage=self.coverage.aligned(own))

    def of(self, topic: str) -> Frame:
        """Return a topic's records, empty when it does not occur."""
        found = self.rows.get(topic)
        return Frame.of(topic_of(topic)) if found is None else found


class MemoryLog:
    """Takes a side's records like a log file; ``log`` equals what `tis.deploy.logs.read.load.load_side` would return.

    Oracle: the same twin with files (tests/deploy/logs/read/test_memory).
    """

    def __init__(self, side: Side) -> None:
        self._log = SideLog(side)
        self._rows: defaultdict[str, list[Row]] = defaultdict(list)
        self._messages: defaultdict[str, list[Record]] = defaultdict(list)

    def record(self, record: Record) -> None:
        """Keep one record."""
        key = record.topic
        if key == PICTURES:
            return
        if isinstance(record.data, Message):
            waiting: list[Any] = self._rows[key]
            waiting.append(as_row(record.data))
            self._log.n_messages += 1
            self._log.last_ns = max(self._log.last_ns, record.log_ns)
        else:
            waiting = self._messages[key]
            waiting.append(record)
        # many at a time, as numpy is slow on single values
        if len(waiting) >= _WAITING:
            self._settle(key)

    @property
    def log(self) -> SideLog:
        """Return the log so far."""
        for key in (*self._rows, *self._messages):
            self._settle(key)
        return self._log

    def _settle(self, key: str) -> None:
        rows, messages = self._rows.pop(key, ()), self._messages.pop(key, ())
        if rows:
            self._log.add_rows(key, rows)
        if messages:
            self._log.add_block(key, _block(messages), np.arange(len(messages)))


def _block(records: Sequence[Record]) -> Block:
    """Return messages as a block of a log."""
    payloads = [record.data for record in records]
    assert all(isinstance(payload, bytes) for payload in payloads)
    head = bytes(MESSAGE_HEAD_BYTES)
    body = b"".join(part for payload in payloads for part in (head, payload))  # type: ignore[misc]
    end = np.cumsum([len(head) + len(payload) for payload in payloads])  # type: ignore[arg-type]
    start = np.append(0, end[:-1])
    seq, log_ns = (np.array([getattr(one, name) for one in records], dtype=np.int64) for name in ("seq", "log_ns"))
    sent_ns = [one.log_ns if one.publish_ns is None else one.publish_ns for one in records]
    return Block(body, start, end, np.zeros_like(seq), seq, log_ns, np.array(sent_ns, dtype=np.int64))


def check_rows(topic: Topic | None, rows: Sequence[Row]) -> None:
    """Raise `ValueError` for rows that are not of their topic's model; of an unknown topic, for what is not flat."""
    if topic is not None:
        convert(rows, list[topic.model])  # type: ignore[name-defined]
        return
    for row in rows:
        for value in row.values():
            if isinstance(value, dict | list):
                raise ValueError("a record is not flat")
            if type(value) is int:
                checked_number(value)


def _batch(topic: str, row: Row) -> dict[str, NDArray[Any]]:
    """Return a batch's columns as arrays."""
    try:
        n = len(row["seq"])
        rare = {name: row.get(name) or [0] * n for name in _RARE if name in PACKETS[topic]}
        columns = {name: _coded(name, (row | rare)[name]) for name in PACKETS[topic] if name != "foreign"}
        if not all(isinstance(row[name], str) for name in ("direction", "key")) or not isinstance(
            row["foreign"], bool
        ):
            raise TypeError("a batch is of one direction and key")
    except UNREADABLE:
        raise other_version(topic) from None
    if any(len(column) != n for column in columns.values()):
        raise DataError(Fault(topic, "", "holds a batch with columns of different lengths"))
    return {"foreign": np.full(n, row["foreign"], dtype=np.int64), **columns}


def _coded(name: str, values: list[Any]) -> Ints:
    codes = _CODES.get(name)
    return integers(values if codes is None else [codes[value] for value in values])


def _fingerprint(payload: bytes) -> int:
    """Return 63 bits of a cryptographic hash, so that nobody can write a payload for a given one."""
    return int.from_bytes(blake2b(payload, digest_size=8).digest(), "little") >> 1
