"""The 20-byte header in the Zenoh attachment of every message of the testbed.

It identifies the packet without decoding its payload, so that netem can address a fate by sequence number, and it
carries the send time, which is known only after the payload has been encoded. The run's number, which netem draws
and gives with the epoch, tells a message of another run, such as one that a side left behind.
"""

import struct
from typing import Final, NamedTuple, Self

_LAYOUT: Final = struct.Struct("<4sIqI")
HEADER_BYTES: Final = _LAYOUT.size
CODE_BYTES: Final = 16
"""Bytes behind the header of a signed message (`tis.common.signing`)."""
_LENGTHS: Final = (HEADER_BYTES, HEADER_BYTES + CODE_BYTES)
_MAGIC: Final = b"tis\x02"  # the last byte is the version of the layout


class Header(NamedTuple):
    """Sequence number of the packet on its key, run time (ns) of its sending, and number of its run."""

    seq: int
    sent_ns: int = 0
    run_id: int = 0

    def pack(self) -> bytes:
        """Return the attachment's bytes; raises `struct.error` for numbers beyond 32, 64 and 32 bits."""
        return _LAYOUT.pack(_MAGIC, self.seq, self.sent_ns, self.run_id)

    @classmethod
    def unpack(cls, attachment: bytes) -> Self | None:
        """Return the header, or None for a foreign attachment (oracle: tests/common/test_header)."""
        numbers = header_numbers(attachment)
        return None if numbers is None else cls(*numbers)


def header_numbers(attachment: bytes) -> tuple[int, int, int] | None:
    """Return the fields of a header as a plain tuple, which netem makes for each packet; None for a foreign one."""
    if len(attachment) not in _LENGTHS or not attachment.startswith(_MAGIC):
        return None
    _, seq, sent_ns, run_id = _LAYOUT.unpack_from(attachment)
    return seq, sent_ns, run_id
