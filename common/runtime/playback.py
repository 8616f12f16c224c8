"""Logs read back, whole or damaged."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mcap.exceptions
import zstandard
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import MCAP0_MAGIC, Writer

from common.errors import DataError, Fault

_LONGEST_RECORD = 1 << 30
_DAMAGE = (
    mcap.exceptions.McapError,
    CRCValidationError,
    zstandard.ZstdError,
    struct.error,
    ValueError,
    LookupError,
    MemoryError,
)


@dataclass
class LogReader:
    """Goes through a log once, in the order of the file; stops quietly where the file is damaged.

    Afterwards ``damage`` says what stopped it, or is None; ``metadata`` and ``attachments`` hold what was found.
    """

    path: Path
    damage: str | None = None
    metadata: dict[str, str] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def messages(self) -> Iterator[tuple[str, Message]]:
        """Yield (topic, message); raises `DataError` when the file cannot be opened or is no MCAP file at all."""
        for record in self._records():
            if isinstance(record, Message):
                yield self.channels[record.channel_id].topic, record
            elif isinstance(record, Channel):
                self.channels[record.id] = record
            elif isinstance(record, Schema):
                self.schemas[record.id] = record
            elif isinstance(record, Attachment):
                self.attachments[record.name] = record.data
            elif isinstance(record, Metadata) and record.name == "run":
                self.metadata = dict(record.metadata)

    def _records(self) -> Iterator[McapRecord]:
        try:
            with self.path.open("rb") as file:
                if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                    raise DataError(Fault(str(self.path), "", "is no MCAP file"))
                file.seek(0)
                reader = StreamReader(file, validate_crcs=True, record_size_limit=_LONGEST_RECORD)
                try:
                    yield from reader.records
                except _DAMAGE as error:
                    self.damage = str(error) or type(error).__name__
        except OSError as error:
            raise DataError(Fault(str(self.path), "", f"cannot be read: {error.strerror}")) from None


@dataclass(frozen=True)
class Recovery:
    """What came out of a damaged log."""

    n_messages: int
    last_ns: int
    damage: str | None


def recover(damaged: Path, recovered: Path) -> Recovery:
    """Write all that can be read of ``damaged`` to a new, complete file; raises `DataError`.

    Schemas, channels, messages, attachments and metadata are kept; ``damage`` is None when nothing was missing.
    """
    log = LogReader(damaged)
    n_messages, last_ns = 0, 0
    partial = recovered.with_suffix(recovered.suffix + ".part")
    try:
        with partial.open("wb") as file:
            writer = Writer(file)
            writer.start(profile="", library="tis")
            ids: dict[int, int] = {}
            schema_ids: dict[int, int] = {0: 0}
            for _, message in log.messages():
                channel_id = ids.get(message.channel_id)
                if channel_id is None:
                    channel_id = _copy_channel(writer, log, message.channel_id, schema_ids)
                    ids[message.channel_id] = channel_id
                writer.add_message(channel_id, message.log_time, message.data, message.publish_time, message.sequence)
                n_messages += 1
                last_ns = max(last_ns, message.log_time)
            for name, data in log.attachments.items():
                writer.add_attachment(0, 0, name, _media_type(name), data)
            if log.metadata:
                writer.add_metadata("run", log.metadata)
            writer.finish()  # type: ignore[no-untyped-call]
        partial.replace(recovered)
    except OSError as error:
        raise DataError(Fault(str(recovered), "", f"cannot be written: {error.strerror}")) from None
    finally:
        partial.unlink(missing_ok=True)
    return Recovery(n_messages, last_ns, log.damage)


def _copy_channel(writer: Writer, log: LogReader, channel_id: int, schema_ids: dict[int, int]) -> int:
    channel = log.channels[channel_id]
    if channel.schema_id not in schema_ids:
        schema = log.schemas[channel.schema_id]
        schema_ids[channel.schema_id] = writer.register_schema(schema.name, schema.encoding, schema.data)
    new_id: int = writer.register_channel(
        channel.topic, channel.message_encoding, schema_ids[channel.schema_id], channel.metadata
    )
    return new_id


def _media_type(name: str) -> str:
    return "application/json" if name.endswith(".json") else "application/yaml"
