"""Protocol between a probe and its far end: keys below the probe's own, and batches of stamps."""

import json
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from tis.deploy.net.probing.message_pairing import Stamp

MAX_ROWS: Final = 5_000
"""Stamps in one batch, 120 kB."""

_ROW_BYTES: Final = 24


def clock_key(key: str) -> str:
    """Return the key of the far end's clock; not a control key, because it must take the path of the messages."""
    return f"{key}/clock"


def stamps_key(key: str) -> str:
    """Return the key of the far end's stamps; the selector ``?from=N`` gives the first one."""
    return f"{key}/stamps"


class Batch(NamedTuple):
    """Stamps of the far end named ``name``, from number ``first`` on, of the ``total`` so far."""

    name: str
    first: int
    total: int
    rows: Sequence[Stamp]

    def pack(self) -> tuple[bytes, bytes]:
        """Return a reply's payload, three big-endian int64 a row, and its attachment."""
        about = {"name": self.name, "first": self.first, "total": self.total}
        return np.array(self.rows, dtype=">i8").tobytes(), json.dumps(about).encode()

    @classmethod
    def unpack(cls, payload: bytes, attachment: bytes) -> "Batch | None":
        """Return the batch, None when it is malformed (oracle: tests/deploy/net/probing/test_far_keys)."""
        try:
            about = json.loads(attachment)
            name, first, total = about["name"], about["first"], about["total"]
        except (ValueError, KeyError, TypeError, RecursionError):
            return None
        counts = type(first) is int and type(total) is int and isinstance(name, str)
        if not counts or len(payload) % _ROW_BYTES or not 0 <= first <= first + len(payload) // _ROW_BYTES <= total:
            return None
        rows = np.frombuffer(payload, dtype=">i8").reshape(-1, 3).tolist()
        return cls(name, first, total, [(seq, mark, came_ns) for seq, mark, came_ns in rows])
