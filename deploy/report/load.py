"""The logs of a run: own records as rows, what comes by the million as columns."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic_core import from_json

from common.channels import Direction, Side, direction_of
from common.clocks.model import ClockModel
from common.errors import DataError, Fault
from common.records import FATES, RELEASES, Departure, FateBatch, Outcome, ReleaseBatch
from common.runtime.collector import without_collector
from common.runtime.heap import give_back_large_arrays
from common.runtime.mcap_chunks import by_channel
from deploy.logs.blocks import Block
from deploy.logs.choice import log_files
from deploy.logs.coverage import FOREVER, WHOLE, Coverage
from deploy.logs.log_file import LogFile, torn_at_once
from deploy.report.clocks import CLOCK_TOPICS, RunClocks, aligned_rows, run_clocks, senders
from deploy.report.compact_ints import CompactInts
from deploy.report.payload_instants import NO_INSTANT, payload_instants
from deploy.report.rows import Row, Rows, column_model

Ints = NDArray[np.int64]

_WRITTEN_BY: Final = "tis"
_CODES: Final[Mapping[str, Mapping[str, int]]] = {
    "outcome": {name: code for code, name in enumerate(get_args(Outcome))},
    "departure": {name: code for code, name in enumerate(get_args(Departure))},
}
_ALIKE: Final = ("direction", "key")
_COLUMNS: Final = {
    topic: tuple(name for name in model.model_fields if name not in (*_ALIKE, "foreign"))
    for topic, model in ((FATES, FateBatch), (RELEASES, ReleaseBatch))
}


class MessageColumns:
    """The messages of one key that a side sent or received, in the order of its log."""

    def __init__(self) -> None:
        self._seq, self._sent, self._log, self._sample, self._command = (CompactInts() for _ in range(5))

    def append(self, payload: Row, seq: int, sent_ns: int, log_ns: int) -> None:
        """Add a message; of its payload only the instants are kept."""
        sample_ns, command_ns = payload.get("sample_ns"), payload.get("command_sample_ns")
        self._seq.append(seq)
        self._sent.append(sent_ns)
        self._log.append(log_ns)
        self._sample.append(NO_INSTANT if sample_ns is None else sample_ns)
        self._answer(np.array([NO_INSTANT if command_ns is None else command_ns]))

    def extend(self, block: Block, which: Ints) -> None:
        """Add some of a block's messages, by index."""
        sample_ns, command_ns = payload_instants(block, which)
        self._seq.extend(block.seq[which])
        self._sent.extend(block.publish_ns[which])
        self._log.extend(block.log_ns[which])
        self._sample.extend(sample_ns)
        self._answer(command_ns)

    def _answer(self, commands_ns: Ints) -> None:
        """Add the latest messages' commands; those of a key that answers none take no room."""
        if len(self._command) or (commands_ns != NO_INSTANT).any():
            n_before = len(self._seq) - len(commands_ns)
            self._command.extend(np.full(n_before - len(self._command), NO_INSTANT))
            self._command.extend(commands_ns)

    def aligned(self, own: ClockModel, sender: ClockModel, surgeon: ClockModel) -> "MessageColumns":
        """Return the messages with every stamp by the reference's clock, each from the clock that made it."""
        found = MessageColumns()
        found._seq = self._seq
        found._log = _moved(self._log, own)
        found._sent, found._sample = _moved(self._sent, sender), _moved(self._sample, sender)
        found._command = _moved(self._command, surgeon)
        return found

    def __len__(self) -> int:
        return len(self._seq)

    @property
    def seq(self) -> Ints:
        """Return the sequence numbers, (N,)."""
        return self._seq.values()

    @property
    def sent_ns(self) -> Ints:
        """Return when each was sent, (N,)."""
        return self._sent.values()

    @property
    def log_ns(self) -> Ints:
        """Return when each was sent or received here, (N,)."""
        return self._log.values()

    @property
    def sample_ns(self) -> Ints:
        """Return the sample instants, (N,)."""
        return self._sample.values()

    @property
    def command_sample_ns(self) -> Ints:
        """Return the sample instant of the command that each answers, (N,); `NO_INSTANT` where there is none."""
        if not len(self._command):
            return np.full(len(self), NO_INSTANT, dtype=np.int64)
        return self._command.values()


@dataclass
class SideLog:
    """One side's log: its own records by topic, in the order they were written, and the messages by key.

    ``batches`` holds `FateBatch` and `ReleaseBatch` records, by topic: those of one direction and key put together
    as one, whose columns are `CompactInts`, ``foreign`` too.
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
    """What a damaged or recovered log lacks."""

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
            self._add_batch(topic, row)
        else:
            self._rows_of(topic).append(row)

    def add_block(self, topic: str, block: Block, which: Ints) -> None:
        """Add a block's messages on a topic, by index; raises `DataError` as `add` does."""
        self.n_messages += len(which)
        self.last_ns = max(self.last_ns, int(block.log_ns[which].max(initial=0)))
        if not topic.startswith("/"):
            self.messages.setdefault(topic, MessageColumns()).extend(block, which)
            return
        try:
            rows = from_json(b"[" + b",".join(block.payloads(which)) + b"]")
            if topic in _COLUMNS:
                for row in rows:
                    self._add_batch(topic, row)
            else:
                self._rows_of(topic).extend(rows)
        except (LookupError, TypeError, ValueError, OverflowError):
            raise DataError(Fault(topic, "", "holds records that this version does not know")) from None

    def _add_batch(self, topic: str, row: Row) -> None:
        """Put a batch behind those like it."""
        columns = _batch(topic, row)
        known = self.batches.setdefault(topic, [])
        alike = (batch for batch in known if all(batch[name] == row[name] for name in _ALIKE))
        whole = next(alike, None)
        if whole is None:
            whole = {name: row[name] for name in _ALIKE} | {name: CompactInts() for name in ("foreign", *columns)}
            known.append(whole)
        whole["foreign"].extend(np.full(len(columns["seq"]), row["foreign"], dtype=np.int64))
        for name, column in columns.items():
            whole[name].extend(column)

    def _rows_of(self, topic: str) -> Rows | list[Row]:
        rows = self.rows.get(topic)
        if rows is None:
            model = column_model(topic)
            rows = self.rows[topic] = [] if model is None else Rows(model)
        return rows

    def aligned(self, clocks: RunClocks) -> "SideLog":
        """Return the log with every stamp by the reference's clock."""
        own, surgeon = clocks.model(self.side), clocks.model("surgeon")
        messages = dict(self.messages)
        for key, columns in self.messages.items():
            sender = senders(key)
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
        """Return a topic's rows, none when it does not occur."""
        return self.rows.get(topic, [])


@dataclass
class RunLogs:
    """The logs that a run folder holds, by side; all stamps by the reference's clock, which is netem's."""

    run_dir: Path
    sides: dict[Side, SideLog] = field(default_factory=dict)
    clocks: RunClocks = field(default_factory=RunClocks)

    def of(self, side: Side, topic: str) -> Sequence[Row]:
        """Return a side's rows of a topic; none when the log is missing."""
        log = self.sides.get(side)
        return [] if log is None else log.of(topic)

    def columns(self, side: Side, topic: str) -> Rows:
        """Return a side's records of a topic that `column_model` knows, as columns; none when there are none."""
        rows, model = self.of(side, topic), column_model(topic)
        assert model is not None, topic
        return rows if isinstance(rows, Rows) else Rows(model)

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
        found += [f"{side}: {text}" for side, log in self.sides.items() if (text := log.coverage.problem)]
        return found

    def coverage(self, side: Side) -> Coverage | None:
        """Return what a side's log lacks; None where it is missing or tells nothing at all."""
        log = self.sides.get(side)
        return None if log is None or log.coverage.void else log.coverage

    @property
    def all_tell(self) -> bool:
        """Tell whether there is a log of each side with anything in it."""
        return all(self.coverage(side) is not None for side in get_args(Side))


def load_side(path: Path, side: Side, wanted: Collection[str] | None = None) -> SideLog:
    """Read one log: the testbed's own records by topic, and the messages that it sent and received by key.

    ``wanted`` limits it to some topics; `last_ns` is that of all.

    A damaged log gives what can be read of it. Raises `DataError` when the file is no log, or none of this version.
    """
    file = LogFile(path)
    log = SideLog(side, {}, {}, {})
    for block in file.blocks():
        check_ours(file)
        for channel_id, which in by_channel(block.channel):
            topic = file.topic(channel_id)
            if wanted is None or topic in wanted:
                log.add_block(topic, block, which)
            else:
                log.last_ns = max(log.last_ns, int(block.log_ns[which].max()))
    check_ours(file)
    log.metadata = file.metadata.get("run", {})
    log.coverage = Coverage.of(file, log.last_ns)
    log.attachments = {name: attachment.data for name, attachment in file.attachments.items()}
    return log


def check_ours(file: LogFile) -> None:
    """Raise `DataError` when somebody else wrote a file that was read."""
    if file.header is not None and file.header.library != _WRITTEN_BY:
        raise DataError(Fault(str(file.path), "", f"is no log of tis, but of {file.header.library!r}"))


def _batch(topic: str, row: Row) -> dict[str, Ints]:
    """Return a batch's columns as arrays."""
    try:
        columns = {name: _column(name, row[name]) for name in _COLUMNS[topic]}
    except (LookupError, TypeError, ValueError, OverflowError):
        raise DataError(Fault(topic, "", "holds records that this version does not know")) from None
    if len({len(column) for column in columns.values()}) > 1:
        raise DataError(Fault(topic, "", "holds a batch with columns of different lengths"))
    return columns


def _column(name: str, values: list[Any]) -> Ints:
    codes = _CODES.get(name)
    return np.array(values if codes is None else [codes[value] for value in values], dtype=np.int64)


def _moved(instants: CompactInts, model: ClockModel) -> CompactInts:
    if model.shared:
        return instants
    ns = instants.values()
    found = CompactInts()
    found.extend(np.where(ns == NO_INSTANT, NO_INSTANT, model.to_reference_ns(ns)))
    return found


def load_run(run_dir: Path, wanted: Collection[str] | None = None) -> RunLogs:
    """Read the logs of a run folder, those that are there, damaged ones as far as they go.

    ``wanted`` limits it to some topics, beside those that say what the clocks are. A recovered log is read in place
    of the damaged one (`deploy.logs.choice`). Raises `DataError` for each file that is no log of this version.

    What other clocks stamped is converted to netem's (`deploy.report.clocks`). A side that is killed before its log's
    first flush leaves an empty file.
    """
    give_back_large_arrays()
    logs, faults = RunLogs(run_dir), list[Fault]()
    wanted = None if wanted is None else {*wanted, *CLOCK_TOPICS}
    for side, path in log_files(run_dir).items():
        try:
            if torn := torn_at_once(path):
                logs.sides[side] = void_log(side, path, torn)
                continue
            with without_collector():
                logs.sides[side] = load_side(path, side, wanted)
        except DataError as error:
            faults += [replace(fault, where=str(path), field=_topic(path, fault)) for fault in error.faults]
    if faults:
        raise DataError(faults)
    return aligned(logs)


def void_log(side: Side, path: Path, damage: str) -> SideLog:
    """Return the log of a side that was killed before it had written anything."""
    return SideLog(side, {}, {}, {}, coverage=Coverage(path.name, damage, unknown=((0, FOREVER),)))


def _topic(path: Path, fault: Fault) -> str:
    """Return which records of a log are at fault, if the fault is said of some."""
    return fault.field if fault.where == str(path) else fault.where


def aligned(logs: RunLogs) -> RunLogs:
    """Return logs as they were written with all stamps by the reference's clock."""
    mode = next((log.metadata["mode"] for log in logs.sides.values() if "mode" in log.metadata), "live")
    last_ns = {side: log.last_ns for side, log in logs.sides.items()}
    clocks = run_clocks({side: log.rows for side, log in logs.sides.items()}, last_ns, mode)
    if clocks.all_shared:
        return replace(logs, clocks=clocks)
    return replace(logs, sides={side: log.aligned(clocks) for side, log in logs.sides.items()}, clocks=clocks)
