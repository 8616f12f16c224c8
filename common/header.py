"""The 20-byte header in the Zenoh attachment of every message of the testbed.

It identifies the packet without decoding its payload, so that netem can address a fate by sequence number, and it
carries the send time, which is known only after the payload has been encoded.
"""

import struct
from typing import Final, NamedTuple, Self

_LAYOUT: Final = struct.Struct("<4sIqI")
HEADER_BYTES: Final = _LAYOUT.size
_MAGIC: Final = b"tis\x01"  # the last byte is the version of the layout
_CHECK: Final = 0x5449_5321  # a trailing word tells the header from a foreign attachment of equal length


class Header(NamedTuple):
    """Sequence number of the packet on its key, and the run time (ns) of its sending."""

    seq: int
    sent_ns: int = 0

    def pack(self) -> bytes:
        """Return the attachment's bytes; raises `struct.error` for numbers beyond 32 and 64 bits."""
        return _LAYOUT.pack(_MAGIC, self.seq, self.sent_ns, _CHECK)

    @classmethod
    def unpack(cls, attachment: bytes) -> Self | None:
        """Return the header, or None for a foreign attachment (oracle: tests/common/test_header)."""
        if len(attachment) != _LAYOUT.size:
            return None
        magic, seq, sent_ns, check = _LAYOUT.unpack(attachment)
        if magic != _MAGIC or check != _CHECK:
            return None
        return cls(seq, sent_ns)
