"""A child process that lists the queryables of a network: a Zenoh client that reads what its router has declared.

It reads its own admin space, never a router's. Up to Zenoh 1.10 an answer of the admin space takes the lock of the
routing tables twice; a declaration in between leaves them locked forever (Zenoh's pull request 2619). A `Valve` holds
back declarations meanwhile, if the connection to the router is a plain socket. A deadlock that occurs nevertheless is
limited to this process: a timer ends it, and `tis.netem.bridge.mirrors.listing` starts another.

Standard input has one line (`Settings` as JSON); its end ends the process. Standard output gets an empty line first,
then a line per reading: the keys as JSON if they have changed, else an empty line as a sign of life.
"""

import contextlib
import fcntl
import json
import os
import select
import signal
import socket
import struct
import sys
import tempfile
import termios
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from typing import Final, NamedTuple, NoReturn

import zenoh

_POLL_S: Final = 0.001
_PROCESSING_S: Final = 0.003
_TIMEOUT_S: Final = 1.0
_CHUNK: Final = 1 << 16
_PAUSE_S: Final = 0.1
_PAUSE_RATIO: Final = 20  # pause over processor time of a reading: bounds the load of many queryables
_MAX_PAUSE_S: Final = 0.5
_MAX_READ_S: Final = 0.5
_ANSWER_S: Final = 2.0
_UNUSED_KEY: Final = "@tis/netem/nobody"


class Valve:
    """A relay of bytes between a client of this process and its router, which can hold back the router's bytes.

    It is open at first; when one end closes, so does the other. Behind a closed valve no declaration arrives. If the
    client deadlocks nevertheless, the valve still reads from the router: a slow reader would block the router, and
    with it all its traffic.
    """

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


Closed = Callable[[], AbstractContextManager[None]]


class Settings(NamedTuple):
    """The client's configuration (JSON), and the key expressions that listed queryables overlap."""

    config: str
    within: Sequence[str]


def main() -> NoReturn:
    """List the queryables of a network until standard input ends, or until its router is gone."""
    with contextlib.suppress(OSError):  # netem's threads may have a real-time class
        os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    settings = Settings(**json.loads(sys.stdin.readline()))
    threading.Thread(target=_end_with_input, daemon=True).start()
    try:
        _list(settings)
    except (zenoh.ZError, TimeoutError, OSError) as error:
        print(error, file=sys.stderr, flush=True)  # noqa: T201
    os._exit(1)  # closing a deadlocked session would never end


def _list(settings: Settings) -> None:
    session, closed = _open(zenoh.Config.from_json5(settings.config))
    routers = session.info.routers_zid()
    _held = [session.declare_querier(key, target=zenoh.QueryTarget.ALL) for key in settings.within]
    # a router answers in order: this answer comes after the declarations of all queryables
    if any(reply.ok is None for reply in session.liveliness().get(_UNUSED_KEY, timeout=_ANSWER_S)):
        raise TimeoutError("the router does not answer")
    print(flush=True)  # noqa: T201  (from here on, silence means a deadlock)
    last: list[str] | None = None
    while routers and session.info.routers_zid() == routers:
        began_s = time.thread_time()
        keys = _read(session, settings.within, closed)
        print("" if keys == last else json.dumps(keys), flush=True)  # noqa: T201
        last = keys
        time.sleep(min(max(_PAUSE_S, _PAUSE_RATIO * (time.thread_time() - began_s)), _MAX_PAUSE_S))
    raise TimeoutError("the router is gone")


def _open(config: zenoh.Config) -> tuple[zenoh.Session, Closed]:
    """Open a session, through a valve if possible; return a context manager that closes the valve."""
    with valve_to(json.loads(config.get_json("connect/endpoints"))) as opened:
        if opened is None:
            return zenoh.open(config), contextlib.nullcontext
        endpoint, valves = opened
        config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        config.insert_json5("transport/link/protocols", '["unixsock-stream"]')
        session = zenoh.open(config)
        return session, valves[0].closed


def _read(session: zenoh.Session, within: Sequence[str], closed: Closed) -> list[str]:
    """Return the key expressions of the queryables that the router has declared to the session."""
    prefix = f"@/{session.zid()}/client/queryable/"
    found: set[str] = set()
    ends: list[threading.Event] = []

    def take(reply: zenoh.Reply) -> None:
        if reply.ok is not None:
            found.add(str(reply.ok.key_expr).removeprefix(prefix))

    signal.setitimer(signal.ITIMER_REAL, _MAX_READ_S)  # its signal ends this process
    with closed():
        for key in within:
            ends.append(threading.Event())
            # the replies arrive within the call; a Zenoh channel would be full after 256 of them, with no reader
            handler = zenoh.handlers.Callback(take, ends[-1].set, indirect=False)
            session.get(prefix + key, handler, consolidation=zenoh.ConsolidationMode.NONE, timeout=_ANSWER_S)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if not all(end.wait(_ANSWER_S) for end in ends):  # the router is queried too, and answers with an end only
        raise TimeoutError("the router does not answer")
    return sorted(found)


def _end_with_input() -> NoReturn:
    while sys.stdin.buffer.read(1):
        pass
    os._exit(0)


if __name__ == "__main__":
    main()
