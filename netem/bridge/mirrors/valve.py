"""A valve between a Zenoh client of this process and its router: a relay that can hold back the router's bytes.

A client that reads its own admin space during a declaration of its router may deadlock
(`tis.netem.bridge.mirrors.lister`); behind a closed valve no declaration arrives. If the client deadlocks
nevertheless, the valve still reads from the router: a slow reader would block the router, and with it all its
traffic.
"""

import fcntl
import os
import select
import socket
import struct
import tempfile
import termios
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Final

_POLL_S: Final = 0.001
_PROCESSING_S: Final = 0.003
_TIMEOUT_S: Final = 1.0
_CHUNK: Final = 1 << 16


class Valve:
    """A relay of bytes in both directions, open at first; when one end closes, so does the other."""

    def __init__(self, router: socket.socket, client: socket.socket) -> None:
        self._router = router
        self._client = client
        self._kept = bytearray()
        self._is_open = True
        self._lock = threading.Lock()
        self._rings = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        client.setblocking(False)
        threading.Thread(target=self._carry, name="valve", daemon=True).start()

    @contextmanager
    def closed(self) -> Iterator[None]:
        """Hold back the router's bytes for the length of the block, once the client has read all earlier ones."""
        with self._lock:
            self._is_open = False
        try:
            while self._n_unread():
                time.sleep(_POLL_S)
            time.sleep(_PROCESSING_S)  # the bytes have been read; now the client processes them
            yield
        finally:
            self._is_open = True
            os.eventfd_write(self._rings, 1)

    def _n_unread(self) -> int:
        """Return the bytes in the kernel that the client has not read yet."""
        (n,) = struct.unpack("i", fcntl.ioctl(self._client, termios.TIOCOUTQ, b"\0\0\0\0"))
        return int(n)

    def _carry(self) -> None:
        try:
            while self._carry_some():
                pass
        except OSError:
            pass
        for end in (self._router, self._client):
            end.close()

    def _carry_some(self) -> bool:
        """Wait for bytes and relay them; False when one end has closed."""
        router, client = self._router.fileno(), self._client.fileno()
        gives = (client,) if self._kept and self._is_open else ()
        ready, _, _ = select.select((router, client, self._rings), gives, ())
        if self._rings in ready:
            os.eventfd_read(self._rings)
        if router in ready:
            received = self._router.recv(_CHUNK)
            if not received:
                return False
            self._kept += received
        with self._lock:
            if self._kept and self._is_open:
                with suppress(BlockingIOError):
                    del self._kept[: self._client.send(self._kept)]
        if client in ready:
            received = self._client.recv(_CHUNK)
            if not received:
                return False
            self._router.sendall(received)
        return True


@contextmanager
def valve_to(endpoints: Sequence[str]) -> Iterator[tuple[str, list[Valve]] | None]:
    """Yield the endpoint of a valve to the first router that answers; one client must connect to it in the block.

    The list has the valve once the client has connected. Yields None if an endpoint is not a plain socket (TLS).
    Raises `OSError` if no router answers.
    """
    addresses = [_address(endpoint) for endpoint in endpoints]
    if None in addresses:
        yield None
        return
    router = _connect([address for address in addresses if address is not None])
    valves: list[Valve] = []
    with tempfile.TemporaryDirectory(prefix="tis-netem-") as folder, socket.socket(socket.AF_UNIX) as door:
        door.bind(f"{folder}/valve")
        door.listen(1)

        def accept() -> None:
            valves.append(Valve(router, door.accept()[0]))

        threading.Thread(target=accept, daemon=True).start()
        yield f"unixsock-stream/{folder}/valve", valves


def _address(endpoint: str) -> str | tuple[str, int] | None:
    """Return the address of an endpoint that is a plain socket: a path, or host and port."""
    protocol, _, place = endpoint.partition("/")
    if any(mark in place for mark in "?#"):
        return None
    if protocol == "unixsock-stream":
        return place
    host, _, port = place.rpartition(":")
    return (host.strip("[]"), int(port)) if protocol == "tcp" and port.isdecimal() else None


def _connect(addresses: Sequence[str | tuple[str, int]]) -> socket.socket:
    failed = OSError("no endpoint")
    for address in addresses:
        try:
            return _connect_to(address)
        except OSError as error:
            failed = error
    raise failed


def _connect_to(address: str | tuple[str, int]) -> socket.socket:
    if not isinstance(address, str):
        router = socket.create_connection(address, timeout=_TIMEOUT_S)
        router.settimeout(None)
        return router
    router = socket.socket(socket.AF_UNIX)
    try:
        router.connect(address)
    except OSError:
        router.close()
        raise
    return router
