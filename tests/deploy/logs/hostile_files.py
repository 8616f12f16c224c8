"""MCAP files made by hand, record by record, also such as no writer makes."""

import struct
from pathlib import Path

import zstandard
from mcap.opcode import Opcode
from mcap.writer import MCAP0_MAGIC

MIB = 1 << 20


def record(opcode: int, content: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def text(content: str | bytes) -> bytes:
    data = content.encode() if isinstance(content, str) else content
    return struct.pack("<I", len(data)) + data


def channel(number: int, topic: str) -> bytes:
    return record(Opcode.CHANNEL, struct.pack("<HH", number, 0) + text(topic) + text("json") + struct.pack("<I", 0))


def message(payload: bytes, log_ns: int = 5, publish_ns: int = 5, number: int = 1) -> bytes:
    return record(Opcode.MESSAGE, struct.pack("<HIQQ", number, 0, log_ns, publish_ns) + payload)


def chunk(data: bytes, n_bytes: int, compression: str, start_ns: int = 0) -> bytes:
    head = struct.pack("<QQQI", start_ns, max(start_ns, 5), n_bytes, 0)
    return record(Opcode.CHUNK, head + text(compression) + struct.pack("<Q", len(data)) + data)


def packed(records: bytes) -> bytes:
    return chunk(zstandard.compress(records), len(records), "zstd")


def repeated(unit: bytes, n_bytes: int, before: bytes = b"") -> bytes:
    """Return a chunk of ``unit`` over and over, made without holding it in memory."""
    data = bytearray()
    block = unit * (MIB // len(unit))
    n_blocks = n_bytes // len(block)
    size = len(before) + n_blocks * len(block)
    packer = zstandard.ZstdCompressor().compressobj(size=size)
    data += packer.compress(before)
    for _ in range(n_blocks):
        data += packer.compress(block)
    data += packer.flush()
    return chunk(bytes(data), size, "zstd")


def write(path: Path, *records: bytes, library: str = "tis", run: dict[str, str] | None = None) -> Path:
    head = record(Opcode.HEADER, text("") + text(library))
    metadata = b"".join(text(key) + text(value) for key, value in (run or {}).items())
    about = record(Opcode.METADATA, text("run") + text(metadata))
    end = record(Opcode.DATA_END, bytes(4)) + record(Opcode.FOOTER, bytes(20))
    path.write_bytes(MCAP0_MAGIC + head + about + b"".join(records) + end + MCAP0_MAGIC)
    return path
