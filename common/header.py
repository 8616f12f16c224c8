"""The 20 bytes that travel in the Zenoh attachment of every message of ours.

They name the packet without its payload being decoded, so netem can address a fate by sequence number, and they
say when it was sent, which is known only after the payload has been written.
"""

import struct
from typing import Final, NamedTuple, Self

_LAYOUT: Final = struct.Struct("<4sIqI")
HEADER_BYTES: Final = _LAYOUT.size
_MAGIC: Final = b"tis\x01"  # the last byte is the version of the layout
_CHECK: Final = 0x5449_5321  # a trailing word: a foreign attachment of equal length is not taken for ours


class Header(NamedTuple):
    """Sequence number of the packet on its key, and the run time (ns) of its sending."""

    seq: int
    sent_ns: int = 0

    def pack(self) -> bytes:
        """Return the attachment's bytes; raises `struct.error` outside 32/64 bit."""
        return _LAYOUT.pack(_MAGIC, self.seq, self.sent_ns, _CHECK)

    @classmethod
    def unpack(cls, attachment: bytes) -> Self | None:
        """Return the header, or None when the attachment is not ours (oracle: tests/common/test_header)."""
        if len(attachment) != _LAYOUT.size:
            return None
        magic, seq, sent_ns, check = _LAYOUT.unpack(attachment)
        if magic != _MAGIC or check != _CHECK:
            return None
        return cls(seq, sent_ns)
