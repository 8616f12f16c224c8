"""Health of this process's TCP connections, as Linux reports it: bytes that nobody acknowledges."""

import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Final

_TABLES: Final = ("/proc/self/net/tcp", "/proc/self/net/tcp6")
_ESTABLISHED: Final = "01"
_RETRANSMITTING: Final = "01"
_MIN_RETRANSMITS: Final = 1
_IPV4_BYTES: Final = 4
_DISCARD_PORT: Final = 9


def is_retransmitting(ports: set[int]) -> bool | None:
    """Tell whether a connection of this process with one of these ports, here or there, sends again and again.

    A host whose process stands still still acknowledges; a network that carries nothing does not. None: not known, as
    where no such connection is TCP. Oracle: a namespace whose link is taken down, tests/system/test_peers.
    """
    try:
        own = set(_own_sockets())
    except OSError:
        return None
    rows = [row for table in _TABLES for row in _rows(table)]
    ours = [
        row for row in rows if row[9] in own and row[3] == _ESTABLISHED and ports & {_port(row[1]), _port(row[2])}
    ]
    if not ours:
        return None
    return any(_is_stuck(row) for row in ours)


def _is_stuck(row: list[str]) -> bool:
    """Tell whether bytes are sent again, or cannot be sent as the way to the other host is gone."""
    timer = row[5].partition(":")[0]
    waiting_bytes = int(row[4].partition(":")[0], 16)
    if timer == _RETRANSMITTING:
        return int(row[6], 16) >= _MIN_RETRANSMITS
    return waiting_bytes > 0 and not _has_route(row[2])


def _has_route(address: str) -> bool:
    """Tell whether this host knows a way to an address of the table, such as 0201090A:1D17; nothing is sent."""
    words = bytes.fromhex(address.partition(":")[0])
    packed = b"".join(words[i : i + 4][::-1] for i in range(0, len(words), 4))  # words of the host's byte order
    family = socket.AF_INET if len(packed) == _IPV4_BYTES else socket.AF_INET6
    try:
        with socket.socket(family, socket.SOCK_DGRAM) as probe:
            probe.connect((socket.inet_ntop(family, packed), _DISCARD_PORT))
    except OSError:
        return False
    return True


def _rows(table: str) -> Iterator[list[str]]:
    try:
        lines = Path(table).read_text(encoding="ascii").splitlines()[1:]
    except OSError:  # a host without IPv6 has one table
        return
    for line in lines:
        yield line.split()


def _port(address: str) -> int:
    return int(address.rpartition(":")[2], 16)


def _own_sockets() -> Iterator[str]:
    """Yield the inodes of this process's sockets."""
    for name in Path("/proc/self/fd").iterdir():
        try:
            target = str(name.readlink())
        except OSError:
            continue
        if target.startswith("socket:["):
            yield target[8:-1]
