"""MCAP chunks as arrays over one buffer, not as message objects.

The mcap package's readers make an object of each message, which takes 4 us; a run at 1 kHz logs ten million messages
in ten minutes. So this module walks the chunks; the package's classes read the other records.
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

from common.runtime.mcap_chunks import MESSAGE_HEAD_BYTES, RECORD_HEAD, Ints

FIELDS: Final = np.dtype([("channel", "<u2"), ("seq", "<u4"), ("log", "<u8"), ("publish", "<u8")])
OF_FIELDS: Final = np.arange(RECORD_HEAD.size, MESSAGE_HEAD_BYTES)
"""A message's header, and the positions of its bytes in the record."""

_MAX_BYTES: Final = 1 << 30


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
    """The content of a chunk."""

    block: Block
    schemas: list[Schema]
    channels: list[Channel]


_Records = tuple[Ints, Ints, list[Schema], list[Channel]]


def unpack_chunk(chunk: Chunk) -> bytes:
    """Return a chunk's records, decompressed; raises `ValueError` on a wrong checksum or broken compression."""
    if chunk.uncompressed_size > _MAX_BYTES:
        raise ValueError("a chunk claims to be larger than 1 GiB")
    try:
        if chunk.compression == "zstd":
            body: bytes = zstandard.decompress(chunk.data, chunk.uncompressed_size)
        elif chunk.compression == "lz4":
            body = lz4.frame.decompress(chunk.data)
        elif chunk.compression == "":
            body = chunk.data
        else:
            raise ValueError(f"a chunk is compressed with {chunk.compression!r}, which tis cannot read")
    except (zstandard.ZstdError, RuntimeError, MemoryError):
        raise ValueError("a chunk cannot be decompressed") from None
    if chunk.uncompressed_crc not in (0, zlib.crc32(body)):
        raise ValueError("a chunk's checksum differs")
    return body


def parse_records(body: bytes) -> Parsed:
    """Return the messages, schemas and channels of a chunk's records; raises `ValueError` when they are damaged.

    Oracle: the mcap package's reader, message by message (test_blocks).
    """
    start, end, schemas, channels = _walk(body)
    if (end - start < MESSAGE_HEAD_BYTES).any():
        raise ValueError("a chunk's records are damaged")
    heads = np.frombuffer(body, dtype=np.uint8)[start[:, np.newaxis] + OF_FIELDS].view(FIELDS)[:, 0]
    fields = (heads[name].astype(np.int64) for name in ("channel", "seq", "log", "publish"))
    return Parsed(Block(body, start, end, *fields), schemas, channels)


def _walk(body: bytes) -> _Records:
    """Walk the records; raises `ValueError` when the last one does not end at the end of ``body``.

    Records are chained by their lengths. Reading the file's index instead would take longer than this loop.
    """
    # local names: this loop runs once per message
    starts: list[int] = []
    ends: list[int] = []
    schemas: list[Schema] = []
    channels: list[Channel] = []
    head_at, message, n_head = RECORD_HEAD.unpack_from, Opcode.MESSAGE.value, RECORD_HEAD.size
    started, ended = starts.append, ends.append
    position, until = 0, len(body)
    try:
        while position < until:
            opcode, length = head_at(body, position)
            end = position + n_head + length
            if opcode == message:
                started(position)
                ended(end)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                content = ReadDataStream(BytesIO(body[position + n_head : end]))
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
