"""An MCAP file in large pieces: a chunk's messages as arrays and one piece of bytes, not as objects.

One object for each message, as the mcap package's readers make, takes 4 us; a run at 1 kHz logs ten million in ten
minutes. So the container is walked here, and its records are read by the package's own classes.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import Final, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Schema
from numpy.typing import NDArray

Ints = NDArray[np.int64]

RECORD_HEAD: Final = struct.Struct("<BQ")
MESSAGE_HEAD_BYTES: Final = 31
"""Opcode and length of a message's record, then its own header: what comes before the payload."""

_LENGTH: Final = struct.Struct("<Q")
_FIELDS: Final = np.dtype([("channel", "<u2"), ("seq", "<u4"), ("log", "<u8"), ("publish", "<u8")])
_OF_LENGTH: Final = np.arange(1, RECORD_HEAD.size)
_INDEX_HEAD_BYTES: Final = 6
_OF_FIELDS: Final = np.arange(RECORD_HEAD.size, MESSAGE_HEAD_BYTES)
_LARGEST_BYTES: Final = 1 << 30


class Block(NamedTuple):
    """N messages as they lie in ``body``: ``start`` and ``end`` (N,) bound their records, the rest are their headers.

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
    """What a chunk holds."""

    block: Block
    schemas: list[Schema]
    channels: list[Channel]


_Records = tuple[Ints, Ints, list[Schema], list[Channel]]


def by_channel(channel: Ints) -> Iterator[tuple[int, Ints]]:
    """Yield each channel's number and which messages (of N, in their order) are its own."""
    order = np.argsort(channel, kind="stable")
    ids, first = np.unique(channel[order], return_index=True)
    if len(ids):
        yield from zip(ids.tolist(), np.split(order, first[1:]), strict=True)


def unpack_chunk(chunk: Chunk) -> bytes:
    """Return a chunk's records, decompressed; raises `ValueError` when its checksum differs or it cannot be."""
    if chunk.uncompressed_size > _LARGEST_BYTES:
        raise ValueError("a chunk says it is larger than 1 GiB")
    try:
        if chunk.compression == "zstd":
            body: bytes = zstandard.decompress(chunk.data, chunk.uncompressed_size)
        elif chunk.compression == "lz4":
            body = lz4.frame.decompress(chunk.data)
        elif chunk.compression == "":
            body = chunk.data
        else:
            raise ValueError(f"a chunk is compressed with {chunk.compression!r}, which nobody here can read")
    except (zstandard.ZstdError, RuntimeError, MemoryError):
        raise ValueError("a chunk cannot be decompressed") from None
    if chunk.uncompressed_crc not in (0, zlib.crc32(body)):
        raise ValueError("a chunk's checksum differs")
    return body


def index_offsets(content: bytes) -> Ints:
    """Return where the messages of one channel begin in their chunk, from a message index's content."""
    return np.frombuffer(content, dtype="<u8", offset=_INDEX_HEAD_BYTES)[1::2].astype(np.int64)


def parse_records(body: bytes, indexed: Ints | None = None) -> Parsed:
    """Return the messages, schemas and channels of a chunk's records; raises `ValueError` when they are damaged.

    ``indexed`` is where messages begin, as the file's own indexes have it: only what lies between them is walked
    through then, unless it is not so. Oracle: the mcap package's reader, message by message (test_blocks).
    """
    found = None if indexed is None else _by_index(body, indexed)
    start, end, schemas, channels = found or _walk(body, 0, len(body))
    if (end - start < MESSAGE_HEAD_BYTES).any():
        raise ValueError("a chunk's records are damaged")
    heads = np.frombuffer(body, dtype=np.uint8)[start[:, np.newaxis] + _OF_FIELDS].view(_FIELDS)[:, 0]
    fields = (heads[name].astype(np.int64) for name in ("channel", "seq", "log", "publish"))
    return Parsed(Block(body, start, end, *fields), schemas, channels)


def _walk(body: bytes, position: int, until: int) -> _Records:
    """Go from record to record; raises `ValueError` when the last one does not end where it should."""
    starts: list[int] = []
    ends: list[int] = []
    schemas: list[Schema] = []
    channels: list[Channel] = []
    length_at = _LENGTH.unpack_from
    try:
        while position < until:
            opcode, end = body[position], position + RECORD_HEAD.size + length_at(body, position + 1)[0]
            if opcode == Opcode.MESSAGE:
                starts.append(position)
                ends.append(end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                content = ReadDataStream(BytesIO(body[position + RECORD_HEAD.size : end]))
                if opcode == Opcode.SCHEMA:
                    schemas.append(Schema.read(content))
                else:
                    channels.append(Channel.read(content))
            position = end
    except (struct.error, UnicodeDecodeError, McapError):
        raise ValueError("a chunk's records are damaged") from None
    if position != until:
        raise ValueError("a chunk's records are damaged")
    return np.array(starts, dtype=np.int64), np.array(ends, dtype=np.int64), schemas, channels


def _by_index(body: bytes, indexed: Ints) -> _Records | None:
    """Return what `_walk` would, or None when the index does not name exactly the messages there are."""
    start = np.sort(indexed)
    if not len(start) or start[0] < 0 or start[-1] + MESSAGE_HEAD_BYTES > len(body):
        return None
    data = np.frombuffer(body, dtype=np.uint8)
    lengths = data[start[:, np.newaxis] + _OF_LENGTH].view("<i8")[:, 0]
    end = start + RECORD_HEAD.size + lengths
    first, last = np.append(0, end), np.append(start, len(body))
    if (data[start] != Opcode.MESSAGE).any() or (lengths < 0).any() or (first > last).any():
        return None
    schemas: list[Schema] = []
    channels: list[Channel] = []
    for gap in np.flatnonzero(first < last).tolist():
        others, _, its_schemas, its_channels = _walk(body, int(first[gap]), int(last[gap]))
        if len(others):
            return None
        schemas += its_schemas
        channels += its_channels
    return start, end, schemas, channels
