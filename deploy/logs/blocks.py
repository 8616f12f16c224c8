"""MCAP chunks as arrays over one buffer, not as message objects, and the records around them.

The mcap package's readers make an object of each message, which takes 4 us; a run at 1 kHz logs ten million messages
in ten minutes. So this module walks the chunks; the package's classes read the other records.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import BinaryIO, Final, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from mcap.writer import MCAP0_MAGIC

from tis.common.runtime.chunk_writer import MESSAGE_HEAD_BYTES, RECORD_HEAD, Ints

# Limits of reading a log: a hostile file is refused before it takes memory or time.
#
# All are far beyond the logs of the testbed: an hour at 1 kHz takes some 2 GB and 60 million messages, in chunks of
# 128 KiB to 1 MiB with up to 5000 messages, and its records are compressed to a tenth to a third.

MAX_CHUNK_BYTES: Final = 64 << 20
"""Size of a decompressed chunk; recorders of other programs write chunks of 1 to 4 MiB."""

MAX_CHUNK_RECORDS: Final = 1 << 18
"""Records of a chunk; a chunk of 4 MiB with messages of no content holds half as many."""

MAX_EXPANSION: Final = 100
FREE_BYTES: Final = 128 << 20
"""Decompressed bytes of a file: so many for each byte of the file, beyond a first amount that is free."""

FREE_RECORDS: Final = 1 << 19
"""Records of a file: one for each byte of the file, beyond the first ones; a compressed message takes 20 bytes."""

MAX_READ_TIMES: Final = 8
FREE_READ_BYTES: Final = 64 << 20
"""Bytes read from a file: each byte so often, as the search behind damage reads bytes again."""

MAX_RECORD_BYTES: Final = 300_000_000
"""Size of a record on disk; the largest are attached traces, of up to 256 MB."""

MAX_METADATA_BYTES: Final = 1 << 20
"""Size of a metadata record; the list of 40 000 gaps of a recovered log fits."""

MAX_CHANNELS: Final = 4096
MAX_SCHEMAS: Final = 4096
MAX_ATTACHMENTS: Final = 1000
MAX_METADATA: Final = 1000
"""Numbers of them in a file; a run has a channel per topic, some thirty in all."""

MAX_JSON_BYTES: Final = 4 << 20
"""JSON decoded at a time, and size of a record's payload; a batch of 20 000 packets takes 1.5 MB.

As Python objects JSON takes up to 25 times its size.
"""

MAX_NUMBER: Final = 1 << 62
"""Integers and instants of a log, either way: 146 years in ns. Differences of two fit 64 bits."""

MAX_WORD_CHARS: Final = 256
MAX_WORDS: Final = (1 << 15) - 1
"""Length and number of the texts in one field of frequent records: of names and keys, which repeat.

A column of texts takes as much for each of its rows as for the longest.
"""


class RecordContent(ReadDataStream):
    """A record's content for the mcap package's decoders, which trust the lengths in it.

    Raises `ValueError` where a length exceeds the record. Oracle: mutated records, tests/deploy/logs/test_hostile.
    """

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self._n_bytes: Final = len(content)

    def read(self, length: int) -> bytes:
        """Return the next ``length`` bytes."""
        if length > self._n_bytes - self.count:
            raise ValueError("a record's lengths exceed the record")
        return super().read(length)


class ReadingBudget:
    """Bytes and records that a file of ``n_bytes`` may still take; raises `SpentError` beyond."""

    def __init__(self, n_bytes: int) -> None:
        self._read_bytes = FREE_READ_BYTES + MAX_READ_TIMES * n_bytes
        self._bytes = FREE_BYTES + MAX_EXPANSION * n_bytes
        self._records = FREE_RECORDS + n_bytes

    def read(self, n_bytes: int) -> None:
        """Take bytes that are read from the file."""
        self._read_bytes -= n_bytes
        if self._read_bytes < 0:
            raise SpentError("the file's damaged places overlap too often")

    def unpack(self, n_bytes: int) -> None:
        """Take bytes that a chunk has decompressed."""
        self._bytes -= n_bytes
        if self._bytes < 0:
            raise SpentError(f"the chunks hold more than {MAX_EXPANSION} times the bytes of the file")

    def parse(self, n_records: int) -> None:
        """Take records."""
        self._records -= n_records
        if self._records < 0:
            raise SpentError(f"the file has more than {FREE_RECORDS} records, and one for each of its bytes")


class SpentError(Exception):
    """A file that takes more than its size admits; nothing more of it is read."""


def record_heads(file: BinaryIO, n_bytes: int) -> Iterator[tuple[int, int]]:
    """Yield opcode and length of each record outside of chunks; the file stands at its content.

    Raises `ValueError` at damage, also of the magic bytes.
    """
    if file.read(len(MCAP0_MAGIC)) != MCAP0_MAGIC:
        raise ValueError("is no MCAP file")
    position = len(MCAP0_MAGIC)
    while True:
        file.seek(position)
        opcode, head, length = read_head(file, n_bytes - position)
        yield opcode, length
        position += len(head) + length


def read_head(file: BinaryIO, n_left: int) -> tuple[int, bytes, int]:
    """Return opcode, head and length of the next record; raises `ValueError` when it exceeds ``n_left`` bytes."""
    head = file.read(RECORD_HEAD.size)
    if len(head) < RECORD_HEAD.size:
        raise ValueError("the file ends early")
    opcode, length = RECORD_HEAD.unpack(head)
    if opcode == 0 or len(head) + length > n_left:
        raise ValueError("the file ends early" if opcode else "a record is invalid")
    return opcode, head, length


FIELDS: Final = np.dtype([("channel", "<u2"), ("seq", "<u4"), ("log", "<u8"), ("publish", "<u8")])
OF_FIELDS: Final = np.arange(RECORD_HEAD.size, MESSAGE_HEAD_BYTES)
"""A message's header, and the positions of its bytes in the record."""

_BEYOND_INT64: Final = np.uint64(1 << 63)


class Block(NamedTuple):
    """N messages in ``body``: ``start`` and ``end`` (N,) bound their records, the other arrays are their headers.

    The payload of message i is ``body[start[i] + MESSAGE_HEAD_BYTES : end[i]]``.
    """

    body: bytes
    start: Ints
    end: Ints
    channel: Ints
    seq: Ints
    log_ns: Ints
    publish_ns: Ints

    def payloads(self, which: Ints | slice) -> Iterator[bytes]:
        """Yield the payloads of some messages, by index."""
        body = self.body
        first = (self.start[which] + MESSAGE_HEAD_BYTES).tolist()
        for start, end in zip(first, self.end[which].tolist(), strict=True):
            yield body[start:end]


class Parsed(NamedTuple):
    """The content of a chunk, of ``n_records`` in all."""

    block: Block
    schemas: list[Schema]
    channels: list[Channel]
    n_records: int


_Records = tuple[Ints, Ints, list[Schema], list[Channel], int]


def unpack_chunk(chunk: Chunk) -> bytes:
    """Return a chunk's records, decompressed; raises `ValueError` on a wrong checksum or broken compression.

    It takes no more memory than the chunk states, at most `MAX_CHUNK_BYTES`, whatever its compressed data states.
    """
    n_bytes = chunk.uncompressed_size
    if n_bytes > MAX_CHUNK_BYTES:
        raise ValueError(f"a chunk states {n_bytes} bytes, more than {MAX_CHUNK_BYTES}")
    try:
        if chunk.compression == "zstd":
            body = _unpack_zstd(chunk.data, n_bytes)
        elif chunk.compression == "lz4":
            body = _unpack_lz4(chunk.data, n_bytes)
        elif chunk.compression == "":
            body = chunk.data
        else:
            raise ValueError(f"a chunk is compressed with {chunk.compression[:20]!r}, which tis cannot read")
    except (zstandard.ZstdError, RuntimeError, MemoryError):
        raise ValueError("a chunk cannot be decompressed") from None
    if len(body) > n_bytes:
        raise ValueError("a chunk holds more than it states")
    if chunk.uncompressed_crc not in (0, zlib.crc32(body)):
        raise ValueError("a chunk's checksum differs")
    return body


def _unpack_zstd(data: bytes, n_bytes: int) -> bytes:
    # the size that the frame states would be allocated, not the one given here
    stated = zstandard.get_frame_parameters(data).content_size
    if n_bytes < stated != zstandard.CONTENTSIZE_UNKNOWN:
        raise ValueError(f"a chunk states {n_bytes} bytes, its compressed data {stated}")
    return zstandard.ZstdDecompressor().decompress(data, n_bytes) if n_bytes else b""


def _unpack_lz4(data: bytes, n_bytes: int) -> bytes:
    unpacker = lz4.frame.LZ4FrameDecompressor()
    # one byte more, so that the end of the frame is read too
    body: bytes = unpacker.decompress(data, n_bytes + 1)
    if not unpacker.eof:
        raise ValueError("a chunk holds more than it states, or ends early")
    return body


def parse_records(body: bytes) -> Parsed:
    """Return the messages, schemas and channels of a chunk's records; raises `ValueError` when they are damaged.

    Oracle: the mcap package's reader, message by message (test_blocks).
    """
    start, end, schemas, channels, n_records = _walk(body)
    if (end - start < MESSAGE_HEAD_BYTES).any():
        raise ValueError("a chunk's records are damaged")
    heads = np.frombuffer(body, dtype=np.uint8)[start[:, np.newaxis] + OF_FIELDS].view(FIELDS)[:, 0]
    if any((heads[name] >= _BEYOND_INT64).any() for name in ("log", "publish")):
        raise ValueError("a message has an instant beyond 2**63 ns")
    fields = (heads[name].astype(np.int64) for name in ("channel", "seq", "log", "publish"))
    return Parsed(Block(body, start, end, *fields), schemas, channels, n_records)


def _walk(body: bytes) -> _Records:
    """Walk the records; raises `ValueError` when the last one does not end at the end of ``body``.

    Raises `SpentError` when they are more than `MAX_CHUNK_RECORDS`.

    Records are chained by their lengths. Reading the file's index instead would take longer than this loop.
    """
    # local names: this loop runs once per message
    starts: list[int] = []
    ends: list[int] = []
    schemas: list[Schema] = []
    channels: list[Channel] = []
    head_at, message, n_head = RECORD_HEAD.unpack_from, Opcode.MESSAGE.value, RECORD_HEAD.size
    started, ended = starts.append, ends.append
    position, until, n_records = 0, len(body), 0
    try:
        while position < until:
            n_records += 1
            opcode, length = head_at(body, position)
            end = position + n_head + length
            if n_records > MAX_CHUNK_RECORDS:
                raise SpentError(f"a chunk has more than {MAX_CHUNK_RECORDS} records")
            if opcode == message:
                started(position)
                ended(end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                content = RecordContent(body[position + n_head : end])
                if opcode == Opcode.SCHEMA:
                    schemas.append(Schema.read(content))
                else:
                    channels.append(Channel.read(content))
            elif opcode == 0:
                break
            position = end
    except (struct.error, UnicodeDecodeError, McapError):
        raise ValueError("a chunk's records are damaged") from None
    if position != until:
        raise ValueError("a chunk's records are damaged")
    return np.array(starts, dtype=np.int64), np.array(ends, dtype=np.int64), schemas, channels, n_records
