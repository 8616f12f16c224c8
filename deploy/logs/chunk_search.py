"""Search for the next chunk behind damage."""

import re
import struct
from typing import BinaryIO, Final

from common.runtime.mcap_chunks import RECORD_HEAD

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
