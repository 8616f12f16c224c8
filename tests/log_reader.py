"""Reader of logs by the mcap package, message by message: the oracle of the own readers."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import mcap.exceptions
import zstandard
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, McapRecord, Message, Metadata, Schema
from mcap.stream_reader import CRCValidationError, StreamReader
from mcap.writer import MCAP0_MAGIC

from tis.common.errors import DataError, Fault

_MAX_RECORD_BYTES = 1 << 30
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
    """Reads a log once, in the order of the file, up to its end or to the first damage.

    Afterwards ``damage`` describes the damage, or is None; ``metadata`` and ``attachments`` hold those read.
    """

    path: Path
    damage: str | None = None
    metadata: dict[str, str] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def messages(self) -> Iterator[tuple[str, Message]]:
        """Yield (topic, message); raises `DataError` when the file cannot be opened or is no MCAP file."""
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
                reader = StreamReader(file, validate_crcs=True, record_size_limit=_MAX_RECORD_BYTES)
                try:
                    yield from reader.records
                except _DAMAGE as error:
                    self.damage = str(error) or type(error).__name__
        except OSError as error:
            raise DataError(Fault(str(self.path), "", f"cannot be read: {error.strerror}")) from None


def cut(log: Path) -> None:
    """Cut a log off in the middle of its messages, which follow its attachments."""
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    first = max((each.offset + each.length for each in summary.attachment_indexes), default=0)
    log.write_bytes(log.read_bytes()[: (first + log.stat().st_size) // 2])
