"""Health of this process's TCP connections, as Linux reports it: bytes that nobody acknowledges."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final

_TABLES: Final = ("/proc/self/net/tcp", "/proc/self/net/tcp6")
_ESTABLISHED: Final = "01"
_RETRANSMITTING: Final = "01"
_MIN_RETRANSMITS: Final = 1  # where the own interface is down the kernel counts no further


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
    timer = row[5].partition(":")[0]
    return timer == _RETRANSMITTING and int(row[6], 16) >= _MIN_RETRANSMITS


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
