"""Real connections on loopback through links in real time: bytes in, the same bytes out."""

import hashlib
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import pytest

from tests.netem.bridge.live_bridge import carrying
from tis.common.channels import Direction
from tis.common.errors import PeerError
from tis.common.runtime.ports import free_ports
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.proxy import Proxy
from tis.netem.link.packet import Fate

pytestmark = pytest.mark.live


class _Carried:
    """A proxy to a server of ours."""

    def __init__(self, driver: Driver, proxy: Proxy, address: tuple[str, int]) -> None:
        self.driver, self.proxy, self.address = driver, proxy, address

    def connect(self) -> socket.socket:
        return socket.create_connection(self.address, timeout=20)


@contextmanager
def _carried(
    serve: Callable[[socket.socket], None] | None, segment_bytes: int = 65_536, **network: Any
) -> Iterator[_Carried]:
    over = threading.Event()
    with ExitStack() as stack:
        target = ("127.0.0.1", free_ports(1)[0])
        if serve is not None:
            server = stack.enter_context(socket.create_server(("127.0.0.1", 0)))
            target = server.getsockname()

            def accept() -> None:
                while not over.is_set():
                    try:
                        connection, _ = server.accept()
                    except OSError:
                        return
                    threading.Thread(target=serve, args=[connection], daemon=True).start()

            threading.Thread(target=accept, daemon=True).start()
        stack.callback(over.set)
        yield _Carried(*stack.enter_context(carrying(target, segment_bytes, **network)))


def _echo(connection: socket.socket) -> None:
    with connection:
        while data := connection.recv(65_536):
            connection.sendall(data)
        connection.shutdown(socket.SHUT_WR)


def _read_all(connection: socket.socket) -> bytes:
    found = []
    while data := connection.recv(65_536):
        found.append(data)
    return b"".join(found)


DELAYED = {
    "forward": {"delay": {"kind": "uniform", "low_ms": 1, "high_ms": 30}},
    "feedback": {"delay": {"kind": "constant", "delay_ms": 5}},
}
RATED = {"forward": {"rate": {"kbit_s": 80_000}}, "outages": [{"kind": "periodic", "every_s": 0.2, "for_s": 0.1}]}


@pytest.mark.parametrize("network", [{}, DELAYED, RATED], ids=["clean", "delayed", "rated"])
def test_bytes_cross_in_order_and_unchanged_and_so_does_their_end(network: dict[str, Any]) -> None:
    content = hashlib.shake_256(b"tis").digest(1_500_000)
    with _carried(_echo, 1448 if "rate" in network.get("forward", {}) else 65_536, **network) as carried:
        with carried.connect() as connection:

            def send() -> None:
                connection.sendall(content)
                connection.shutdown(socket.SHUT_WR)

            sender = threading.Thread(target=send)
            sender.start()
            assert _read_all(connection) == content
            sender.join()
        assert carried.proxy.n_bytes == {"forward": len(content), "feedback": len(content)}
        links = carried.driver.links
        assert not any(sum(link.dropped.values()) for link in links.values())


def test_what_is_lost_is_repeated_and_holds_up_its_own_connection_only(monkeypatch: pytest.MonkeyPatch) -> None:
    content = hashlib.shake_256(b"tis").digest(200_000)
    burst = {"kind": "burst", "p_loss": 0.1, "mean_burst": 3, "recovery": {"rto_ms": 50}}
    lossy = {"delay": {"kind": "constant", "delay_ms": 2}, "loss": burst}
    outage = {"kind": "periodic", "every_s": 0.3, "for_s": 0.1, "direction": "forward"}
    fates: list[Fate] = []
    with _carried(_echo, 1448, forward=lossy, outages=[outage]) as carried, ExitStack() as stack:
        offer = carried.driver.offer

        def counted(*words: Any) -> Fate | None:
            fate = offer(*words)
            assert fate is not None
            fates.append(fate)
            return fate

        monkeypatch.setattr(carried.driver, "offer", counted)
        connections = [stack.enter_context(carried.connect()) for _ in range(3)]
        for one in connections:
            threading.Thread(target=lambda one=one: (one.sendall(content), one.shutdown(socket.SHUT_WR))).start()
        for one in connections:
            assert _read_all(one) == content
        links = carried.driver.links
        assert set(links["forward"]._connections.by_name) == {f"connection/{i}" for i in (1, 2, 3)}
        assert not any(sum(link.dropped.values()) for link in links.values())
    assert sum(fate.recovered for fate in fates) > 20


def test_a_delay_holds_in_its_direction_only() -> None:
    with (
        _carried(_echo, forward={"delay": {"kind": "constant", "delay_ms": 150}}) as carried,
        carried.connect() as one,
    ):
        begun_s = time.monotonic()
        one.sendall(b"x")
        assert one.recv(1) == b"x"
        assert time.monotonic() - begun_s >= 0.15
        decided = carried.driver.links
        assert (decided["forward"].offered, decided["feedback"].offered) == (1, 1)


def test_many_connections_do_not_mix() -> None:
    with (
        _carried(_echo, forward={"delay": {"kind": "uniform", "low_ms": 0, "high_ms": 20}}) as carried,
        ExitStack() as stack,
    ):
        connections = [stack.enter_context(carried.connect()) for _ in range(20)]
        for i, one in enumerate(connections):
            one.sendall(bytes([i]) * 1000)
        for i, one in enumerate(connections):
            one.shutdown(socket.SHUT_WR)
            assert _read_all(one) == bytes([i]) * 1000
        assert carried.proxy.n_connections == 20


def test_a_connection_to_nobody_ends() -> None:
    with _carried(None) as carried, carried.connect() as one:
        assert one.recv(1) == b""
        assert carried.proxy.counters()["carry.unanswered"] == 1


def test_a_break_at_the_far_end_reaches_the_near_one() -> None:
    def hang_up(connection: socket.socket) -> None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        connection.recv(1)
        connection.close()  # a reset

    with (
        _carried(hang_up, feedback={"delay": {"kind": "constant", "delay_ms": 20}}) as carried,
        carried.connect() as one,
    ):
        one.sendall(b"x")
        with suppress(ConnectionResetError):
            assert one.recv(1) == b""


def test_a_sender_waits_while_the_receiver_does() -> None:
    """What is under way is bounded, whatever the sender has."""
    hold = threading.Event()

    def slow(connection: socket.socket) -> None:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        hold.wait(30)
        connection.close()

    queue = {"kind": "tail_drop", "max_packets": 1000, "max_bytes": 50_000}
    with _carried(slow, 1448, forward={"rate": {"kbit_s": 10_000_000, "queue": queue}}) as carried:
        with carried.connect() as one:
            one.settimeout(1.0)
            with suppress(TimeoutError):
                for _ in range(100):
                    one.sendall(bytes(1_000_000))
            # the sockets' own buffers, of some MB, and what may be under way
            assert carried.proxy.n_bytes["forward"] < 30_000_000
        hold.set()


def test_a_port_in_use_is_told() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        both: dict[Direction, int] = {"forward": 1, "feedback": 1}
        proxy = Proxy(Driver({}), taken.getsockname(), ("127.0.0.1", 1), "west", both, 100, pytest.fail)
        with pytest.raises(PeerError, match="cannot listen here: Address already in use"):
            proxy.open()
