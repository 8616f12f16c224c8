"""Sequential reader of an MCAP file, complete or damaged."""

import re
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO, Final

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Header, Metadata, Schema
from mcap.writer import MCAP0_MAGIC

from tis.common.errors import DataError, Fault
from tis.common.runtime.chunk_writer import RECORD_HEAD
from tis.deploy.logs.blocks import (
    MAX_ATTACHMENTS,
    MAX_CHANNELS,
    MAX_METADATA,
    MAX_METADATA_BYTES,
    MAX_RECORD_BYTES,
    MAX_SCHEMAS,
    Block,
    Parsed,
    ReadingBudget,
    RecordContent,
    SpentError,
    parse_records,
    read_head,
    unpack_chunk,
)

# Search for the next chunk behind damage.

_CHUNK_RECORD: Final = re.compile(rb"(?=\x06[\s\S]{4}\x00{4}[\s\S]{28})")
_CHUNK_FIXED_BYTES: Final = 40
_HEAD_BYTES: Final = 64
_FIRST_STEP, _LAST_STEP = 1 << 12, 1 << 21


def next_chunk(file: BinaryIO, position: int, n_bytes: int) -> int | None:
    """Return the position of the next intact chunk at or after ``position``; None when there is none.

    The three lengths in a chunk's record (record, data, name of the compression) have to agree.
    """
    # windows overlap, so that a chunk's head is never cut at a window's end; a chunk close by needs no large one
    step = _FIRST_STEP
    while position < n_bytes:
        file.seek(position)
        piece = file.read(step + _HEAD_BYTES)
        for match in _CHUNK_RECORD.finditer(piece):
            start = match.start()
            if start < step and _is_chunk(piece[start : start + _HEAD_BYTES], n_bytes - position - start):
                return position + start
        position += step
        step = min(2 * step, _LAST_STEP)
    return None


def _is_chunk(head: bytes, n_left: int) -> bool:
    if len(head) < 41:
        return False
    (length,) = struct.unpack_from("<Q", head, 1)
    start_ns, end_ns, _, _, n_name = struct.unpack_from("<QQQII", head, RECORD_HEAD.size)
    if length + RECORD_HEAD.size > n_left or start_ns > end_ns or n_name > 4:
        return False
    if head[41 : 41 + n_name] not in (b"", b"lz4", b"zstd") or len(head) < 41 + n_name + 8:
        return False
    # fixed layout of a chunk: times and sizes (40 bytes), name of the compression, length of the data
    (n_data,) = struct.unpack_from("<Q", head, 41 + n_name)
    return bool(n_data + n_name + _CHUNK_FIXED_BYTES == length)


_DAMAGE: Final = (McapError, struct.error, ValueError, LookupError, MemoryError, EOFError)
_GATHERED_BYTES: Final = 1 << 20
_LOOSE: Final = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE)
_DATA: Final = (Opcode.CHUNK, Opcode.MESSAGE, Opcode.DATA_END)
_READ: Final = (*_LOOSE, Opcode.CHUNK, Opcode.HEADER, Opcode.ATTACHMENT, Opcode.METADATA)
_FOOTER_BYTES: Final = RECORD_HEAD.size + 20 + len(MCAP0_MAGIC)


@dataclass
class LogFile:
    """Reads the MCAP file of any program once, chunk by chunk; it stops at damage without an error.

    Damage includes whatever exceeds `tis.deploy.logs.blocks`, so that reading takes bounded memory.

    With ``search`` it continues at the next intact chunk instead. Afterwards ``damage`` describes the first damage,
    or is None; ``n_gaps`` and ``gap_bytes`` count what was skipped, the other fields hold what was found. Messages
    whose channel was lost are left out and counted in ``n_orphans``. ``data_ended``: only the index was still to
    come, so no message is missing outside of the gaps.
    """

    path: Path
    search: bool = False
    damage: str | None = None
    n_gaps: int = 0
    gap_bytes: int = 0
    n_orphans: int = 0
    n_chunks: int = 0
    data_ended: bool = False
    header: Header | None = None
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    attachments: dict[str, Attachment] = field(default_factory=dict)
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    _summary_read: bool = False

    def blocks(self) -> Iterator[Block]:
        """Yield the messages; raises `DataError` when the file cannot be opened or is no MCAP file at all."""
        try:
            with self.path.open("rb") as file:
                if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                    raise DataError(Fault(str(self.path), "", "is no MCAP file"))
                yield from self._blocks(file, self.path.stat().st_size)
        except OSError as error:
            raise DataError(Fault(str(self.path), "", f"cannot be read: {error.strerror}")) from None

    def _blocks(self, file: BinaryIO, n_bytes: int) -> Iterator[Block]:
        budget, gathered = ReadingBudget(n_bytes), _Gathered()
        try:
            for parsed in self._parsed(file, n_bytes, budget, gathered):
                budget.parse(parsed.n_records)
                yield self._taken(parsed, file)
        except SpentError as error:
            with suppress(SpentError):
                for parsed in self._whole(gathered):
                    yield self._taken(parsed, file)
            self.damage = self.damage or str(error)
            self.gap_bytes += max(n_bytes - file.tell(), 1)
            self.data_ended = False

    def _taken(self, parsed: Parsed, file: BinaryIO) -> Block:
        """Return the block of known channels; raises `DataError` for more channels than any recording has."""
        self.schemas |= {schema.id: schema for schema in parsed.schemas}
        self.channels |= {channel.id: channel for channel in parsed.channels}
        for name, found, most in (("channels", self.channels, MAX_CHANNELS), ("schemas", self.schemas, MAX_SCHEMAS)):
            if len(found) > most:
                raise DataError(Fault(str(self.path), name, f"must be at most {most}", len(found)))
        return self._known(parsed.block, file)

    def topic(self, channel_id: int) -> str:
        """Return the topic of a channel that was read."""
        return self.channels[channel_id].topic

    def _known(self, block: Block, file: BinaryIO) -> Block:
        """Return the block without messages of unknown channels."""
        unknown = set(block.channel.tolist()) - self.channels.keys()
        if unknown and self.search and not self._summary_read:
            self._read_summary(file)
            unknown -= self.channels.keys()
        if not unknown:
            return block
        # no schema and no topic: such messages cannot be interpreted
        keep = [channel not in unknown for channel in block.channel.tolist()]
        self.n_orphans += len(keep) - sum(keep)
        self.damage = self.damage or "messages without a channel"
        return Block(block.body, *(column[keep] for column in block[1:]))

    def _parsed(self, file: BinaryIO, n_bytes: int, budget: ReadingBudget, gathered: "_Gathered") -> Iterator[Parsed]:
        """Yield the file's messages, several chunks at a time, as numpy is slow on small arrays."""
        position = len(MCAP0_MAGIC)
        while True:
            try:
                opcode, head, length = read_head(file, n_bytes - position)
                content = _read_content(file, opcode, length, budget)
                if gathered.n_bytes > _GATHERED_BYTES:
                    yield from self._whole(gathered)
                self.data_ended = opcode == Opcode.DATA_END if opcode in _DATA else self.data_ended
                if opcode == Opcode.CHUNK:
                    gathered.add(unpack_chunk(Chunk.read(RecordContent(content))))
                    self.n_chunks += 1
                    budget.unpack(gathered.n_last_bytes)
                elif opcode in _LOOSE:
                    gathered.add(head + content)
                elif opcode == Opcode.FOOTER:
                    yield from self._whole(gathered)
                    if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
                        raise ValueError("the file ends early")
                    return
                else:
                    self._take(opcode, content)
                position += len(head) + length
            except _DAMAGE as error:
                # what was gathered before the damage is intact
                yield from self._whole(gathered)
                self.damage = self.damage or f"{str(error) or type(error).__name__}, at byte {position}"
                if self.data_ended:  # only the index is damaged
                    return
                found = next_chunk(file, position + 1, n_bytes) if self.search else None
                if found is None:
                    self.gap_bytes += n_bytes - position
                    return
                self.n_gaps += 1
                self.gap_bytes += found - position
                position = found
                file.seek(position)

    def _whole(self, gathered: "_Gathered") -> Iterator[Parsed]:
        """Yield the gathered messages, without pieces whose records are damaged despite a correct checksum."""
        # one pass over all pieces; only if that fails, piece by piece to find the damaged one
        pieces = gathered.take()
        try:
            yield parse_records(b"".join(pieces))
        except ValueError:
            for piece in pieces:
                try:
                    yield parse_records(piece)
                except ValueError as error:
                    self.damage = self.damage or str(error)
                    self.gap_bytes += len(piece)

    def _take(self, opcode: int, content: bytes) -> None:
        stream = RecordContent(content)
        if opcode == Opcode.HEADER:
            self.header = Header.read(stream)
        elif opcode == Opcode.ATTACHMENT:
            attachment = Attachment.read(stream)
            self.attachments[attachment.name] = attachment
        elif opcode == Opcode.METADATA:
            metadata = Metadata.read(stream)
            self.metadata[metadata.name] = dict(metadata.metadata)
        if len(self.attachments) > MAX_ATTACHMENTS or len(self.metadata) > MAX_METADATA:
            raise DataError(Fault(str(self.path), "", "has more attachments or metadata than any recording"))

    def _read_summary(self, file: BinaryIO) -> None:
        """Take schemas and channels from the summary at the file's end, if it has one; once."""
        self._summary_read, here = True, file.tell()
        try:
            n_bytes = file.seek(0, 2)
            file.seek(-_FOOTER_BYTES, 2)
            footer = Footer.read(RecordContent(file.read(_FOOTER_BYTES)[RECORD_HEAD.size :]))
            file.seek(footer.summary_start)
            while True:
                opcode, _, length = read_head(file, n_bytes - file.tell())
                content = RecordContent(file.read(length)) if opcode in _LOOSE else None
                if content is not None and opcode == Opcode.SCHEMA:
                    schema = Schema.read(content)
                    self.schemas.setdefault(schema.id, schema)
                elif content is not None and opcode == Opcode.CHANNEL:
                    channel = Channel.read(content)
                    self.channels.setdefault(channel.id, channel)
                else:
                    break
        except (*_DAMAGE, OSError):
            pass  # a damaged summary is ignored
        finally:
            file.seek(here)


def truncated_start(path: Path) -> str | None:
    """Return the damage of a file that is empty or ends within its first bytes; None for any other file.

    Raises `DataError` when it cannot be opened.
    """
    try:
        with path.open("rb") as file:
            head = file.read(len(MCAP0_MAGIC))
    except OSError as error:
        raise DataError(Fault(str(path), "", f"cannot be read: {error.strerror}")) from None
    if len(head) == len(MCAP0_MAGIC) or not MCAP0_MAGIC.startswith(head):
        return None
    return f"the file ends early, at byte {len(head)}" if head else "the file is empty"


class _Gathered:
    """Records to be parsed together."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []
        self.n_bytes = self.n_last_bytes = 0

    def add(self, piece: bytes) -> None:
        """Add the records of a chunk, or one record outside of chunks."""
        self._pieces.append(piece)
        self.n_last_bytes = len(piece)
        self.n_bytes += self.n_last_bytes

    def take(self) -> list[bytes]:
        """Return the pieces and reset."""
        pieces, self._pieces, self.n_bytes = self._pieces, [], 0
        return pieces


def _read_content(file: BinaryIO, opcode: int, length: int, budget: ReadingBudget) -> bytes:
    """Return a record's content, empty for records that are not used; raises `ValueError` for an absurd length."""
    if opcode not in _READ:
        file.seek(length, 1)
        return b""
    most = MAX_METADATA_BYTES if opcode == Opcode.METADATA else MAX_RECORD_BYTES
    if length > most:
        raise ValueError(f"a record has {length} bytes, more than {most}")
    budget.read(length)
    return file.read(length)
