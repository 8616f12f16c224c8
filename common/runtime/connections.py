"""TCP connections of this process: found, cut by their other end, and cut where one keeps a session from closing.

Zenoh closes no single link, but the socket is this process's own.
"""

import json
import os
import socket
import threading
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager, suppress
from typing import Final

import zenoh

_PATIENCE_S: Final = 0.5


def address_of(end: str) -> str:
    """Return address and port of a link's end or of an endpoint, such as tls/127.0.0.1:7447."""
    return end.partition("/")[2].partition("?")[0].partition("#")[0]


def own_sockets() -> Iterator[tuple[int, socket.socket]]:
    """Yield this process's sockets with the numbers of their descriptors, each by another descriptor, for a step."""
    for number in map(int, os.listdir("/proc/self/fd")):  # noqa: PTH208  (names, not paths)
        with suppress(OSError):
            copy = os.dup(number)
            try:
                found = socket.socket(fileno=copy)
            except OSError:  # no socket
                os.close(copy)
                continue
            with found:
                yield number, found


def cut(ends: Collection[str]) -> int:
    """Shut down this process's TCP connections with these addresses and ports; return how many they were."""
    return _cut(lambda peer: _name(peer) in ends)


@contextmanager
def closing(session: zenoh.Session, config: zenoh.Config) -> Iterator[zenoh.Session]:
    """Close a session after the block, although it may be connecting again to a router that does not answer.

    Zenoh waits for such an attempt, for ten seconds, and raises an error then (eclipse-zenoh/zenoh, issue 2675). So
    connections to the session's endpoints are cut where closing lasts. A session that is not closed even so ends
    with its process.
    """
    try:
        yield session
    finally:
        ports = {address_of(endpoint).rpartition(":")[2] for endpoint in _endpoints(config)}
        timer = threading.Timer(_PATIENCE_S, _cut, [lambda peer: str(peer[1]) in ports])
        timer.daemon = True
        timer.start()
        with suppress(zenoh.ZError):
            session.close()  # type: ignore[no-untyped-call]
        timer.cancel()
        timer.join()  # a cut that goes on would meet the next session's connections


def _endpoints(config: zenoh.Config) -> list[str]:
    """Return the endpoints to which a session connects: a list, or one of each mode."""
    found = json.loads(config.get_json("connect/endpoints"))
    if isinstance(found, dict):
        found = [one for each in found.values() for one in each]
    return [one for one in found if isinstance(one, str)]


def _cut(is_meant: Callable[[tuple[object, ...]], bool]) -> int:
    n_cut = 0
    for _, found in own_sockets():
        with suppress(OSError, ValueError):
            if found.family in (socket.AF_INET, socket.AF_INET6) and is_meant(found.getpeername()):
                found.shutdown(socket.SHUT_RDWR)
                n_cut += 1
    return n_cut


def _name(peer: tuple[object, ...]) -> str:
    host, port = str(peer[0]), peer[1]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"
