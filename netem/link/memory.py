"""The memory that a held message takes, so that the bound on a buffer is one on memory.

Measured as the growth of a process (resident set) with thousands of messages held, tests/netem/bridge/test_memory.
"""

from typing import Final

MAX_COPIED_BYTES: Final = 16_384
"""Payload up to which the live emulator copies a message that waits."""

_COPIED_BYTES: Final = 1_000
_SHARED_BYTES: Final = 10_000


def held_bytes(n_bytes: int, copied: bool = True) -> int:
    """Return the memory of a held message with ``n_bytes`` of payload and attachment.

    Not ``copied``, as queries, replies and large messages, it also keeps the buffer in which Zenoh received it. The
    emulator in virtual time holds messages without a buffer, but must decide as the live one does.
    """
    return n_bytes + (_COPIED_BYTES if copied and n_bytes <= MAX_COPIED_BYTES else _SHARED_BYTES)
