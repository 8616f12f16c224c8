"""A proxy of TCP connections whose bytes cross the links of a driver."""

import os
import selectors
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from itertools import count
from typing import Final

from tis.common.channels import DESTINATION, ORIGIN, Direction, Network
from tis.common.errors import Fault, PeerError
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.handshake import Opening
from tis.netem.bridge.way import Budget, Segment, Way

_READ, _WRITE = selectors.EVENT_READ, selectors.EVENT_WRITE
_TURN_S: Final = 0.2
_BACKLOG: Final = 64
_JOIN_S: Final = 2.0

Address = tuple[str, int]


class Proxy:
    """Accepts connections on the one network and continues each on the other.

    Nothing of them is read or changed but an offer of shared memory (`tis.netem.bridge.handshake`).

    Parameters
    ----------
    driver
        The links, in real time; connections are accepted from `open` on, so start it before.
    listen, connect
        Where connections come from, and where they go.
    comes_from
        The network of ``listen``.
    backlog
        Bytes by direction that are taken from the sender of each connection before it has to wait.
    segment_bytes
        The most bytes that cross a link as one packet.
    warn
        Reports what may pass netem.
    """

    def __init__(
        self, driver: Driver, listen: Address, connect: Address, comes_from: Network,
        backlog: Mapping[Direction, int], segment_bytes: int, warn: Callable[[str], None],
    ) -> None:  # fmt: skip
        self.n_connections = 0
        self.n_unanswered = 0
        self.n_withdrawn = 0
        self.n_bytes: dict[Direction, int] = {"forward": 0, "feedback": 0}
        self._driver: Final = driver
        self._listen: Final = listen
        self._connect: Final = connect
        self._outwards: Final[Direction] = next(way for way, network in ORIGIN.items() if network == comes_from)
        self._inwards: Final[Direction] = next(way for way, network in DESTINATION.items() if network == comes_from)
        self._backlog: Final = backlog
        self._segment_bytes = segment_bytes
        self._warn: Final = warn
        self._has_warned = False
        self._selector = selectors.DefaultSelector()
        self._rings = os.eventfd(0, os.EFD_NONBLOCK | os.EFD_CLOEXEC)
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="carry", daemon=True)
        self._listener: socket.socket | None = None
        self._pairs: list[tuple[Way, Way]] = []
        self._connecting: dict[socket.socket, tuple[Way, Way]] = {}
        self._openings: dict[Way, Opening] = {}

    def open(self) -> None:
        """Listen; raises `PeerError` where that is not possible."""
        host, port = self._listen
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        try:
            self._listener = socket.create_server((host, port), family=family, backlog=_BACKLOG)
        except OSError as error:
            where = f"tcp/{host}:{port}"
            raise PeerError(Fault("netem", where, f"cannot listen here: {error.strerror}")) from None
        self._listener.setblocking(False)
        self._selector.register(self._listener, _READ)
        self._selector.register(self._rings, _READ)
        self._thread.start()

    def close(self) -> None:
        """End every connection; a second call does nothing."""
        self._over.set()
        self._ring()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_S)

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        counts = {"carry.connections": self.n_connections, "carry.unanswered": self.n_unanswered}
        counts["carry.shared_memory_withdrawn"] = self.n_withdrawn
        return counts | {f"carry.{direction}.bytes": n for direction, n in self.n_bytes.items()}

    def _ring(self) -> None:
        with suppress(BlockingIOError):
            os.eventfd_write(self._rings, 1)

    def _run(self) -> None:
        try:
            while not self._over.is_set():
                for key, mask in self._selector.select(_TURN_S):
                    self._attend(key.fileobj, mask)
                self._settle()
        except Exception as error:
            self._driver.failed(error)
        finally:
            for pair in list(self._pairs):
                self._end(pair)
            if self._listener is not None:
                self._listener.close()

    def _attend(self, file: object, mask: int) -> None:
        if file is self._listener:
            self._accept()
        elif file == self._rings:
            with suppress(BlockingIOError):
                os.eventfd_read(self._rings)
        elif isinstance(file, socket.socket) and file in self._connecting:
            self._connected(file)
        else:
            for one, other in self._pairs:
                if file is one.source and mask & _READ:
                    self._read(one, other)
                if file is other.source and mask & _READ:
                    self._read(other, one)
                for way in (one, other):
                    if file is way.sink and mask & _WRITE:
                        way.flush()

    def _accept(self) -> None:
        assert self._listener is not None
        with suppress(OSError):  # who connected has gone already
            ours, _ = self._listener.accept()
            theirs = socket.socket(socket.AF_INET6 if ":" in self._connect[0] else socket.AF_INET)
            for one in (ours, theirs):
                one.setblocking(False)
                one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self.n_connections += 1
            # a place is used again, since a link keeps every flow that it has seen
            place = next(i for i in count(1) if all(pair[0].place != i for pair in self._pairs))
            outwards = Way(place, self._outwards, ours, theirs, Budget(self._backlog[self._outwards]), self._ring)
            inwards = Way(place, self._inwards, theirs, ours, Budget(self._backlog[self._inwards]), self._ring)
            self._pairs.append((outwards, inwards))
            self._openings[outwards] = Opening()
            self._connecting[theirs] = self._pairs[-1]
            theirs.connect_ex(self._connect)
            self._selector.register(theirs, _WRITE)

    def _connected(self, theirs: socket.socket) -> None:
        pair = self._connecting.pop(theirs)
        self._selector.unregister(theirs)
        if theirs.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR):
            self.n_unanswered += 1
            self._end(pair)

    def _read(self, way: Way, back: Way) -> None:
        """Offer what has come; the end and a break of the connection cross the link like bytes."""
        try:
            data = way.source.recv(self._segment_bytes)
        except BlockingIOError:
            return
        except OSError:
            way.has_read_all = back.has_read_all = True
            self._offer(way, Segment(way, b"", aborts=True))
            return
        way.has_read_all = not data
        data = self._without_shared_memory(way, back, data)
        way.budget.take(len(data))
        self.n_bytes[way.direction] += len(data)
        if data:
            self._offer(way, Segment(way, data))
        if way.has_read_all:
            self._offer(way, Segment(way, b""))

    def _without_shared_memory(self, way: Way, back: Way, data: bytes) -> bytes:
        """Return what may go on of the bytes read: of the first message of a connection nothing, or the whole."""
        opening = self._openings.get(way)
        if opening is None:
            return data
        data = opening.take(data)
        if data or way.has_read_all:
            del self._openings[way]
            self.n_withdrawn += opening.withdrawn
            if opening.encrypted and _is_local(way.source) and _is_local(back.source) and not self._has_warned:
                self._has_warned = True
                self._warn(
                    "an encrypted connection joins two programs of this machine: if both use shared memory, their "
                    "messages pass netem; switch off transport/shared_memory/enabled in one of them"
                )
        return data

    def _offer(self, way: Way, segment: Segment) -> None:
        fate = self._driver.offer(way.direction, way.name, b"", len(segment.data), segment)
        if fate is None or fate.outcome != "deliver":  # nothing passes any longer, or the stream has a gap
            way.fail()

    def _settle(self) -> None:
        """End what is over, and watch each socket for what its connection waits for."""
        for pair in list(self._pairs):
            one, other = pair
            if one.is_broken or other.is_broken or (one.is_over and other.is_over):
                self._end(pair)
            elif one.sink not in self._connecting:
                self._watch(one.source, reads=one, writes=other)
                self._watch(other.source, reads=other, writes=one)

    def _watch(self, file: socket.socket, reads: Way, writes: Way) -> None:
        mask = _READ if not reads.has_read_all and reads.budget.is_open else 0
        mask |= _WRITE if writes.wants_to_write else 0
        known = self._selector.get_map().get(file)
        if known is None:
            if mask:
                self._selector.register(file, mask)
        elif not mask:
            self._selector.unregister(file)
        elif known.events != mask:
            self._selector.modify(file, mask)

    def _end(self, pair: tuple[Way, Way]) -> None:
        self._pairs.remove(pair)
        for way in pair:
            self._openings.pop(way, None)
            self._connecting.pop(way.source, None)
            with suppress(KeyError, ValueError):
                self._selector.unregister(way.source)
            way.source.close()


def _is_local(connection: socket.socket) -> bool:
    """Tell whether a connection ends on this machine; False when it has ended."""
    with suppress(OSError):
        return bool(connection.getpeername()[0] == connection.getsockname()[0])
    return False
