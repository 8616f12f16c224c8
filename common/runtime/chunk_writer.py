"""Writer of MCAP files from encoded messages, chunk by chunk.

The mcap package's writer takes 6 us per message; here the records of a chunk are joined at once and its indexes
computed as arrays. The package's own classes encode all records of the container.
"""

import itertools
import struct
import zlib
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import BinaryIO, Final, NamedTuple

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

Ints = NDArray[np.int64]

RECORD_HEAD: Final = struct.Struct("<BQ")
MESSAGE_HEAD_BYTES: Final = 31
"""Bytes before the payload: opcode and length of the record, then the header of the message."""
QUICK, THOROUGH = 3, 10
"""Levels of zstd: 2 and 8 ms per MB of records; thorough output is a tenth smaller."""

_MESSAGE: Final = struct.Struct("<BQHIQQ")
_MESSAGE_CODE: Final = int(Opcode.MESSAGE)  # a plain number packs faster
_MESSAGE_REST: Final = MESSAGE_HEAD_BYTES - RECORD_HEAD.size
_MIN_MATCH: Final = 6
"""Digits repeat by chance, and a reference to a shorter match takes more bytes than its digits. Saves 4 to 8 %."""


def encode_message(channel_id: int, seq: int, log_ns: int, publish_ns: int, payload: bytes) -> bytes:
    """Return the record of a message (oracle: the mcap package reads it back)."""
    return _MESSAGE.pack(_MESSAGE_CODE, len(payload) + _MESSAGE_REST, channel_id, seq, log_ns, publish_ns) + payload


def by_channel(channel: Ints) -> Iterator[tuple[int, Ints]]:
    """Yield the id of each channel and the indices of its messages, in order, from the channels (N,)."""
    order = np.argsort(channel, kind="stable")
    ids, first = np.unique(channel[order], return_index=True)
    if len(ids):
        yield from zip(ids.tolist(), np.split(order, first[1:]), strict=True)


def compress(records: bytes, level: int) -> bytes:
    """Return a chunk's records compressed by zstd; equal records give equal bytes."""
    parameters = zstandard.ZstdCompressionParameters.from_level(level, source_size=len(records), min_match=_MIN_MATCH)
    # A new compressor each time: a reused one keeps tables, and its output depends on earlier input.
    return zstandard.ZstdCompressor(compression_params=parameters).compress(records)


_INDEX_ENTRY: Final = np.dtype([("log", "<u8"), ("offset", "<u8")])


class _Packed(NamedTuple):
    """A compressed chunk; ``offset`` (N,) is the position of each message in the uncompressed data."""

    chunk: Chunk
    channel: Ints
    log_ns: Ints
    offset: Ints


class ChunkWriter:
    """Writes chunks with message indexes, statistics and a summary to a file opened for writing.

    ``beside``: a thread compresses one chunk while the next is filled. ``level`` is zstd's, see `mcap_chunks`.
    ``indexed``: write a message index, which takes 16 bytes per message, a third of a log; without it a log can only
    be read from its beginning.
    """

    def __init__(
        self,
        file: BinaryIO,
        library: str,
        profile: str = "",
        level: int = QUICK,
        chunk_bytes: int = 1 << 20,
        indexed: bool = True,
        beside: bool = True,
    ) -> None:
        self._file, self._position, self._level, self._chunk_bytes = file, 0, level, chunk_bytes
        self._indexed, self._n_chunks = indexed, 0
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, Channel] = {}
        self._pending_heads: list[bytes] = []
        self._records: list[bytes] = []
        self._columns: list[tuple[Ints, Ints]] = []
        self._n_bytes = 0
        self._chunk_indexes: list[ChunkIndex] = []
        self._attachment_indexes: list[AttachmentIndex] = []
        self._metadata_indexes: list[MetadataIndex] = []
        self._counts: dict[int, int] = {}
        self._first_ns, self._last_ns = 1 << 63, 0
        self._pool = ThreadPoolExecutor(1) if beside else None
        self._compressing: Future[_Packed] | None = None
        self._write(MCAP0_MAGIC)
        self._write(_encoded(Header(profile=profile, library=library)))

    @property
    def counts(self) -> Mapping[int, int]:
        """Return the number of messages written, by channel."""
        return self._counts

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Return the id of a schema; equal schemas share one."""
        for known in self._schemas.values():
            if (known.name, known.encoding, known.data) == (name, encoding, data):
                return known.id
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas[schema.id] = schema
        self._pending_heads.append(_encoded(schema))
        return schema.id

    def register_channel(self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]) -> int:
        """Return the id of a new channel."""
        channel = Channel(
            id=len(self._channels) + 1,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
            schema_id=schema_id,
        )
        self._channels[channel.id] = channel
        self._pending_heads.append(_encoded(channel))
        return channel.id

    def add(self, records: Sequence[bytes], channel: Ints, log_ns: Ints) -> None:
        """Add N messages in order: their records, and the channels (N,) and log times (N,) in these."""
        ends = np.cumsum([len(record) for record in records])
        first = 0
        while first < len(records):
            # A chunk is full with the first message that reaches its size; ``room`` counts from this call's start.
            room = self._chunk_bytes - self._n_bytes + (ends[first - 1] if first else 0)
            last = min(len(records), int(np.searchsorted(ends, room)) + 1)
            self._records += records[first:last]
            self._columns.append((channel[first:last], log_ns[first:last]))
            self._n_bytes += int(ends[last - 1] - (ends[first - 1] if first else 0))
            first = last
            if self._n_bytes >= self._chunk_bytes:
                self._close_chunk()

    def attach(self, name: str, media_type: str, data: bytes) -> None:
        """Add a file."""
        self._await_chunk()
        record = _encoded(Attachment(create_time=0, log_time=0, name=name, media_type=media_type, data=data))
        self._attachment_indexes.append(
            AttachmentIndex(self._position, len(record), 0, 0, len(data), name, media_type)
        )
        self._write(record)

    def add_metadata(self, name: str, entries: Mapping[str, str]) -> None:
        """Add named entries."""
        self._await_chunk()
        record = _encoded(Metadata(name=name, metadata=dict(entries)))
        self._metadata_indexes.append(MetadataIndex(self._position, len(record), name))
        self._write(record)

    def flush(self, level: int | None = None) -> None:
        """Write the pending messages as a complete chunk, compressed at ``level`` if given."""
        self._close_chunk(level)
        self._await_chunk()

    def finish(self) -> None:
        """Write the pending messages, the indexes and the footer; the file stays open."""
        self.flush()
        if self._pool is not None:
            self._pool.shutdown()
        self._write(_encoded(DataEnd(0)))
        # The summary repeats schemas, channels and indexes in groups, so that a reader need not scan the file.
        summary_start, summary, offsets = self._position, b"", []
        for opcode, group in self._summary():
            data = b"".join(map(_encoded, group))
            if data:
                offsets.append(SummaryOffset(opcode, summary_start + len(summary), len(data)))
                summary += data
        offset_start = summary_start + len(summary)
        summary += b"".join(map(_encoded, offsets))
        # The CRC covers the summary and the footer up to the CRC itself.
        head = RECORD_HEAD.pack(Opcode.FOOTER, 20) + struct.pack("<QQ", summary_start, offset_start)
        crc = zlib.crc32(head, zlib.crc32(summary))
        self._write(summary + _encoded(Footer(summary_start, offset_start, crc)) + MCAP0_MAGIC)

    def _summary(self) -> Sequence[tuple[int, Sequence[McapRecord]]]:
        statistics = Statistics(
            attachment_count=len(self._attachment_indexes),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self._n_chunks,
            message_count=sum(self._counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns if self._counts else 0,
            metadata_count=len(self._metadata_indexes),
            schema_count=len(self._schemas),
        )
        return (
            (Opcode.SCHEMA, list(self._schemas.values())),
            (Opcode.CHANNEL, list(self._channels.values())),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunk_indexes),
            (Opcode.ATTACHMENT_INDEX, self._attachment_indexes),
            (Opcode.METADATA_INDEX, self._metadata_indexes),
        )

    def _close_chunk(self, level: int | None = None) -> None:
        """Write the pending messages, or pass them to the compressing thread."""
        if not self._records:
            return
        channel, log_ns = (np.concatenate(columns) for columns in zip(*self._columns, strict=True))
        records, heads = self._records, self._pending_heads
        self._records, self._columns, self._pending_heads, self._n_bytes = [], [], [], 0
        self._await_chunk()  # chunks must reach the file in order, so at most one is being compressed
        work = (heads, records, channel, log_ns, level or self._level)
        if self._pool is None:
            self._put(_pack(*work))
        else:
            self._compressing = self._pool.submit(_pack, *work)

    def _await_chunk(self) -> None:
        """Wait for the chunk that is being compressed, if any, and write it."""
        if self._compressing is None:
            return
        packed, self._compressing = self._compressing.result(), None
        self._put(packed)

    def _put(self, packed: _Packed) -> None:
        start = self._position
        self._write(_encoded(packed.chunk))
        chunk_bytes, offsets = self._position - start, {}
        for channel_id, which in by_channel(packed.channel):
            self._counts[channel_id] = self._counts.get(channel_id, 0) + len(which)
            if self._indexed:
                offsets[channel_id] = self._position
                self._write(_message_index(channel_id, packed.log_ns[which], packed.offset[which]))
        chunk = packed.chunk
        self._n_chunks += 1
        self._first_ns = min(self._first_ns, chunk.message_start_time)
        self._last_ns = max(self._last_ns, chunk.message_end_time)
        if not self._indexed:
            return
        self._chunk_indexes.append(
            ChunkIndex(
                chunk_length=chunk_bytes,
                chunk_start_offset=start,
                compression=chunk.compression,
                compressed_size=len(chunk.data),
                message_end_time=chunk.message_end_time,
                message_index_length=self._position - start - chunk_bytes,
                message_index_offsets=offsets,
                message_start_time=chunk.message_start_time,
                uncompressed_size=chunk.uncompressed_size,
            )
        )

    def _write(self, data: bytes) -> None:
        self._file.write(data)
        self._position += len(data)


def _pack(heads: list[bytes], records: list[bytes], channel: Ints, log_ns: Ints, level: int) -> _Packed:
    # Schemas and channels precede the messages in the chunk in which they are first used.
    begin = sum(map(len, heads))
    offset = np.fromiter(itertools.accumulate(map(len, records[:-1]), initial=begin), np.int64, len(records))
    data = b"".join([*heads, *records])
    chunk = Chunk(
        compression="zstd",
        data=compress(data, level),
        message_end_time=int(log_ns.max()),
        message_start_time=int(log_ns.min()),
        uncompressed_crc=zlib.crc32(data),
        uncompressed_size=len(data),
    )
    return _Packed(chunk, channel, log_ns, offset)


def _message_index(channel_id: int, log_ns: Ints, offset: Ints) -> bytes:
    """Return the index record of a channel: log time and position in the chunk of each message."""
    entries = np.empty(len(log_ns), dtype=_INDEX_ENTRY)
    entries["log"], entries["offset"] = log_ns, offset
    data = entries.tobytes()
    return RECORD_HEAD.pack(Opcode.MESSAGE_INDEX, 6 + len(data)) + struct.pack("<HI", channel_id, len(data)) + data


def _encoded(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
