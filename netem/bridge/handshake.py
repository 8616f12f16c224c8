"""The first message of a carried Zenoh connection, InitSyn, in which a program offers shared memory.

Two programs of one machine that agree on shared memory send bytes past every link between them, also past netem. The
offer is an extension, which a receiver skips when it does not know it. So the bridge of bytes gives it an unknown
number; from then on the connection is as one between two machines.

The layout is that of Zenoh's protocol 9: two bytes of length, header, version, identity, sizes if flag S, and, if
flag Z, extensions, each a header of a flag Z for one more, two bits of encoding, a flag M and the number.
"""

from typing import Final

_INIT, _ID, _ACK, _SIZES, _EXTENSIONS = 0x01, 0x1F, 0x20, 0x40, 0x80
_VERSION: Final = 9
_LENGTH_BYTES: Final = 2
_SIZES_BYTES: Final = 3
_MORE, _ENCODING, _NUMBER = 0x80, 0x60, 0x0F
_UNIT, _INTEGER, _BYTES = 0x00, 0x20, 0x40
_SHARED_MEMORY: Final = 0x02
_UNKNOWN: Final = 0x0F
_TLS: Final = b"\x16\x03"
_MAX_VARINT: Final = 9


class Opening:
    """The beginning of what the opener of a connection sends, until its first message is complete.

    Attributes
    ----------
    withdrawn
        Whether an offer of shared memory was made unknown.
    encrypted
        Whether the stream is TLS, so that nothing of it can be read.
    """

    def __init__(self) -> None:
        self.withdrawn = self.encrypted = False
        self._held: bytes | None = b""

    def take(self, data: bytes) -> bytes:
        """Return the bytes that may go on: none while the first message is incomplete, unless ``data`` is empty.

        Oracle: messages of Zenoh itself, tests/netem/bridge/test_handshake.
        """
        if self._held is None:
            return data
        self._held += data
        n = _LENGTH_BYTES + int.from_bytes(self._held[:_LENGTH_BYTES], "little")
        is_init = _is_init(self._held)
        if data and is_init and len(self._held) < n:
            return b""
        whole, self._held = self._held, None
        self.encrypted = whole.startswith(_TLS) and not is_init
        place = _offer_in(whole[:n]) if is_init else None
        if place is None:
            return whole
        self.withdrawn = True
        return whole[:place] + bytes([whole[place] & ~_NUMBER | _UNKNOWN]) + whole[place + 1 :]


def _is_init(data: bytes) -> bool:
    """Tell whether bytes begin an InitSyn; fewer than four, which Zenoh never sends alone, do not."""
    beginning = data[_LENGTH_BYTES : _LENGTH_BYTES + 2]
    return len(beginning) == 2 and beginning[0] & (_ID | _ACK) == _INIT and beginning[1] == _VERSION


def _offer_in(message: bytes) -> int | None:
    """Return the place of the offer's header in an InitSyn with its length; None without one, or if it is damaged."""
    try:
        flags = message[_LENGTH_BYTES]
        at = _LENGTH_BYTES + 2
        at += 2 + (message[at] >> 4) + (_SIZES_BYTES if flags & _SIZES else 0)
        has_more = bool(flags & _EXTENSIONS)
        while has_more:
            header = message[at]
            if header & _NUMBER == _SHARED_MEMORY:
                return at
            at, has_more = _after(message, at), bool(header & _MORE)
    except (IndexError, ValueError):
        pass
    return None


def _after(message: bytes, at: int) -> int:
    """Return the place after the extension at ``at``; raises IndexError or ValueError for a damaged one."""
    encoding = message[at] & _ENCODING
    if encoding == _UNIT:
        return at + 1
    if encoding not in (_INTEGER, _BYTES):
        raise ValueError(encoding)
    value, at = 0, at + 1
    for place in range(_MAX_VARINT):
        byte = message[at + place]
        value |= (byte & 0x7F) << 7 * place
        if byte < 0x80:
            break
    at += place + 1
    return at if encoding == _INTEGER else at + value
