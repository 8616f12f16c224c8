"""A relay of UDP datagrams, each of which crosses the links of a driver as a packet.

A client is an address that datagrams come from. Each has a socket of its own to the other end, so that the answers
find it, as behind a network address translator.
"""

import selectors
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from tis.common.channels import DESTINATION, ORIGIN, Direction, Network
from tis.common.errors import Fault, PeerError
from tis.netem.bridge.clients import MAX_CLIENTS, Client, Clients
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.proxy import Address
from tis.netem.link.packet import Packet

_TURN_S: Final = 0.2
_JOIN_S: Final = 2.0
_AT_ONCE: Final = 64  # datagrams of one socket in a turn, so that a flood starves no other
_MAX_BYTES: Final = 65_535
_BUFFER_BYTES: Final = 4_000_000
_SO_RXQ_OVFL: Final = 40  # Linux: the number of datagrams that found the socket's buffer full
_ANCILLARY: Final = socket.CMSG_SPACE(4)


@dataclass(slots=True)
class Datagram:
    """A datagram on its way."""

    relay: "Relay"
    direction: Direction
    client: Client
    data: bytes

    def forward(self, packet: Packet) -> None:
        """Send it, or a copy of it, with the bits flipped that its fate has."""
        self.relay.send(self, packet)

    def drop(self) -> None:
        """Do nothing: UDP tells nobody."""


class Relay:
    """Passes datagrams between the clients of one network and one address of the other, unread.

    Parameters
    ----------
    driver
        The links, in real time; datagrams are accepted from `open` on, so start it before.
    listen, connect
        Where clients send to, and where their datagrams go.
    comes_from
        The network of ``listen``.
    warn
        Reports datagrams that are lost without a decision of the network.
    """

    def __init__(
        self, driver: Driver, listen: Address, connect: Address, comes_from: Network, warn: Callable[[str], None]
    ) -> None:
        self.n_bytes: dict[Direction, int] = {"forward": 0, "feedback": 0}
        self.n_unsent = self.n_refused = self.n_overrun = 0
        self._driver: Final = driver
        self._ends: Final = listen, connect
        self._outwards: Final[Direction] = next(way for way, network in ORIGIN.items() if network == comes_from)
        self._inwards: Final[Direction] = next(way for way, network in DESTINATION.items() if network == comes_from)
        self._warn: Final = warn
        self._told: set[str] = set()
        self._clients: Final = Clients(self._way)
        self._target: tuple[socket.AddressFamily, Any] | None = None
        self._listener: socket.socket | None = None
        self._listener_overrun = 0
        self._selector = selectors.DefaultSelector()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, name="carry", daemon=True)

    def open(self) -> None:
        """Listen; raises `PeerError` where that is not possible or the other end has no address."""
        listen, connect = self._ends
        try:
            self._target = _found(connect)
        except OSError as error:
            raise PeerError(Fault("netem", _shown(connect), f"has no address: {error.strerror}")) from None
        try:
            family, address = _found(listen)
            self._listener = _socket(family, lambda one: one.bind(address))
        except OSError as error:
            raise PeerError(Fault("netem", _shown(listen), f"cannot listen here: {error.strerror}")) from None
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._thread.start()

    def close(self) -> None:
        """Take no more datagrams; a second call does nothing."""
        self._over.set()
        if self._thread.ident is not None:
            self._thread.join(_JOIN_S)

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        counts = {"carry.clients": self._clients.n_seen, "carry.unsent": self.n_unsent}
        counts |= {"carry.refused": self.n_refused, "carry.overrun": self.n_overrun}
        return counts | {f"carry.{direction}.bytes": n for direction, n in self.n_bytes.items()}

    def send(self, datagram: Datagram, packet: Packet) -> None:
        """Send a datagram; called from the threads that release packets, it never blocks."""
        data, client, direction = datagram.data, datagram.client, datagram.direction
        if packet.n_flips:
            data = self._driver.links[direction].payload(packet, data)
        for _ in range(2):  # the first call may only return the error of an earlier datagram
            try:
                if direction == self._outwards:
                    client.way.send(data)
                elif self._listener is not None:
                    self._listener.sendto(data, client.address)
            except ConnectionRefusedError:
                continue
            except OSError:
                break
            return
        self.n_unsent += 1

    def _way(self) -> socket.socket:
        assert self._target is not None, "open() comes first"
        family, address = self._target
        return _socket(family, lambda one: one.connect(address))

    def _run(self) -> None:
        look_s = 0.0
        try:
            while not self._over.is_set():
                for key, _ in self._selector.select(_TURN_S):
                    if key.fileobj is self._listener:
                        self._take_outwards(self._listener)
                    elif isinstance(key.data, Client):
                        self._take_inwards(key.data)
                now_s = time.monotonic()
                if now_s >= look_s:
                    look_s = now_s + 1.0
                    for client in self._clients.silent(now_s):
                        self._end(client)
        except Exception as error:
            self._driver.failed(error)
        finally:
            for client in self._clients:
                self._end(client)
            if self._listener is not None:
                self._listener.close()

    def _end(self, client: Client) -> None:
        self._selector.unregister(client.way)
        client.way.close()

    def _take_outwards(self, listener: socket.socket) -> None:
        for _ in range(_AT_ONCE):
            try:
                data, ancillary, _, address = listener.recvmsg(_MAX_BYTES, _ANCILLARY)
            except OSError:  # there is none left, or an earlier one was not delivered
                return
            self._listener_overrun = self._overrun(ancillary, self._listener_overrun)
            client = self._client(address)
            if client is not None:
                self._offer(self._outwards, client, data)

    def _client(self, address: Any) -> Client | None:
        n_seen = self._clients.n_seen
        try:
            client = self._clients.of(address, time.monotonic())
        except OSError:
            client = None
        if client is None:
            self.n_refused += 1
            self._tell(f"datagrams of more than {MAX_CLIENTS} clients, or without a free socket: they do not cross")
        elif self._clients.n_seen > n_seen:
            self._selector.register(client.way, selectors.EVENT_READ, client)
        return client

    def _take_inwards(self, client: Client) -> None:
        for _ in range(_AT_ONCE):
            try:
                data, ancillary, _, _ = client.way.recvmsg(_MAX_BYTES, _ANCILLARY)
            except OSError:  # there is none left, or nobody listens at the other end
                return
            client.n_overrun = self._overrun(ancillary, client.n_overrun)
            self._clients.used(client, time.monotonic())
            self._offer(self._inwards, client, data)

    def _offer(self, direction: Direction, client: Client, data: bytes) -> None:
        self.n_bytes[direction] += len(data)
        datagram = Datagram(self, direction, client, data)
        self._driver.offer(direction, f"client/{client.place}", b"", len(data), datagram)

    def _overrun(self, ancillary: list[tuple[int, int, bytes]], known: int) -> int:
        """Count the datagrams of a socket that the kernel dropped since ``known``; return how many it dropped."""
        for level, kind, content in ancillary:
            if level == socket.SOL_SOCKET and kind == _SO_RXQ_OVFL and len(content) == 4:
                n = int(struct.unpack("I", content)[0])
                self.n_overrun += (n - known) % (1 << 32)
                if n != known:
                    self._tell("datagrams come faster than netem reads them: some are lost before it decides")
                return n
        return known

    def _tell(self, text: str) -> None:
        if text not in self._told:
            self._told.add(text)
            self._warn(text)


def _found(address: Address) -> tuple[socket.AddressFamily, Any]:
    """Return the first address that a host has, in the form of its family; raises OSError."""
    host, port = address
    family, _, _, _, found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    return family, found


def _socket(family: socket.AddressFamily, attach: Callable[[socket.socket], None]) -> socket.socket:
    """Return a socket that reports what overruns it, with a large buffer as far as the system allows."""
    one = socket.socket(family, socket.SOCK_DGRAM)
    one.setblocking(False)
    one.setsockopt(socket.SOL_SOCKET, _SO_RXQ_OVFL, 1)
    for option in (socket.SO_RCVBUF, socket.SO_SNDBUF):
        with suppress(OSError):
            one.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
    try:
        attach(one)
    except OSError:
        one.close()
        raise
    return one


def _shown(address: Address) -> str:
    host, port = address
    return f"udp/[{host}]:{port}" if ":" in host else f"udp/{host}:{port}"
