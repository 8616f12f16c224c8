"""Heads of a file's records, of which only the opcode and the length are read."""

from collections.abc import Iterator
from typing import BinaryIO

from mcap.writer import MCAP0_MAGIC

from tis.common.runtime.chunk_writer import RECORD_HEAD


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
