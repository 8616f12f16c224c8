"""Real datagrams through links in real time."""

import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from typing import Any

import pytest

from tests.common.runtime.live_zenoh import soon
from tests.netem.bridge.live_bridge import driving
from tis.common.errors import PeerError
from tis.common.runtime.ports import free_ports
from tis.common.scenario.network import NetworkPart
from tis.netem.bridge.carried_network import datagram_network
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.relay import Relay
from tis.netem.build import build_links


class _Relayed:
    """A relay to a server of ours, which keeps the numbers it gets and sends them back."""

    def __init__(
        self, stack: ExitStack, warn: Callable[[str], None] = pytest.fail, serves: bool = True, **network: Any
    ) -> None:  # fmt: skip
        self.heard: list[bytes] = []
        self.sources: set[Any] = set()
        self._over = threading.Event()
        self.address, self.target = (("127.0.0.1", port) for port in free_ports(2, socket.SOCK_DGRAM))
        part = datagram_network(NetworkPart.model_validate(network), "test")
        self.driver = Driver(build_links(part, ["**"], 3, None, "test"))
        self.relay = Relay(self.driver, self.address, self.target, "west", warn)
        stack.callback(self._over.set)
        stack.enter_context(driving(self.driver))
        stack.callback(self.relay.close)
        self.relay.open()
        if serves:
            self.server = stack.enter_context(_bound(self.target[1]))
            threading.Thread(target=self._serve, daemon=True).start()

    def _serve(self) -> None:
        while not self._over.is_set():
            with suppress(OSError):
                data, source = self.server.recvfrom(65_535)
                self.sources.add(source)
                self.heard.append(data)
                self.server.sendto(data, source)

    def client(self) -> socket.socket:
        one = _bound()
        one.connect(self.address)
        return one


def _bound(port: int = 0) -> socket.socket:
    one = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    one.bind(("127.0.0.1", port))
    one.settimeout(0.2)
    return one


@contextmanager
def _relayed(**network: Any) -> Iterator[_Relayed]:
    with ExitStack() as stack:
        yield _Relayed(stack, **network)


def _back(one: socket.socket, n: int) -> list[bytes]:
    """Return ``n`` datagrams, or what has come after ten seconds."""
    found: list[bytes] = []
    until_s = time.monotonic() + 10
    while len(found) < n and time.monotonic() < until_s:
        with suppress(TimeoutError):
            found.append(one.recv(65_535))
    return found


BURSTY = {
    "loss": {"kind": "burst", "p_loss": 0.2, "mean_burst": 3}, "duplicate": {"p_duplicate": 0.1},
    "delay": {"kind": "uniform", "low_ms": 1, "high_ms": 20}, "ordering": "reorder",
}  # fmt: skip


@pytest.mark.live
def test_what_is_offered_is_lost_or_arrives_in_both_directions() -> None:
    n = 400
    with _relayed(forward=BURSTY, feedback=BURSTY) as relayed, relayed.client() as one:
        links = relayed.driver.links
        forward, feedback = links["forward"], links["feedback"]
        found: list[bytes] = []

        def all_is_back(n_sent: int) -> bool:
            is_there = forward.offered == n_sent and not forward.held
            return is_there and feedback.offered == forward.released and not feedback.held

        for begin in range(0, n, 100):  # fewer than fill the buffer of a socket
            for number in range(begin, begin + 100):
                one.send(str(number).encode())
            assert soon(lambda: all_is_back(begin + 100))  # noqa: B023
            found += _back(one, feedback.released - len(found))
        for link in (forward, feedback):
            assert 0 < link.dropped["loss"] < link.offered
            assert link.copied > 0
            assert link.offered + link.copied == link.released + link.dropped["loss"]
        assert (len(relayed.heard), len(found)) == (forward.released, feedback.released)
        numbers = [int(data) for data in relayed.heard]
        assert numbers != sorted(numbers)  # reordered
        assert max(Counter(numbers).values()) == 2  # duplicated
        assert relayed.relay.counters() == {
            "carry.clients": 1, "carry.unsent": 0, "carry.refused": 0, "carry.overrun": 0,
            "carry.forward.bytes": sum(len(str(number)) for number in range(n)),
            "carry.feedback.bytes": sum(map(len, relayed.heard)),
        }  # fmt: skip


@pytest.mark.live
def test_each_client_gets_its_own_answers() -> None:
    with _relayed(forward={"delay": {"kind": "constant", "delay_ms": 5}}) as relayed, ExitStack() as stack:
        clients = [stack.enter_context(relayed.client()) for _ in range(5)]
        for number in range(50):
            clients[number % 5].send(bytes([number % 5, number]))
        for i, one in enumerate(clients):
            assert _back(one, 10) == [bytes([i, number]) for number in range(i, 50, 5)]
        assert len(relayed.sources) == 5


@pytest.mark.live
def test_bits_flip_and_sizes_stay() -> None:
    with _relayed(forward={"corrupt": {"p_corrupt": 1, "bits": 3}}) as relayed, relayed.client() as one:
        for n_bytes in (1, 100, 1400, 60_000):
            one.send(bytes(n_bytes))
            (found,) = _back(one, 1)
            assert (len(found), sum(byte.bit_count() for byte in found)) == (n_bytes, 3)
        one.send(b"")
        assert _back(one, 1) == [b""]


@pytest.mark.live
def test_datagrams_to_nobody_end_nothing() -> None:
    with _relayed(serves=False) as relayed, relayed.client() as one:
        for _ in range(5):
            one.send(b"x")
            time.sleep(0.01)
        assert soon(lambda: relayed.driver.links["forward"].released == 5)
        with _bound(relayed.target[1]) as server:
            server.settimeout(10)
            one.send(b"y")
            assert server.recv(9) == b"y"


@pytest.mark.live
def test_what_overruns_netem_is_counted_and_told() -> None:
    """The kernel tells with the next datagram how many it had no room for."""
    told: list[str] = []
    with ExitStack() as stack:
        relayed = _Relayed(stack, told.append)
        one = stack.enter_context(relayed.client())
        listener = relayed.relay._listener
        assert listener is not None
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        link = relayed.driver.links["forward"]

        def overruns() -> bool:
            for _ in range(2000):
                one.send(bytes(1000))
            return relayed.relay.n_overrun > 0

        assert soon(overruns)
        assert soon(lambda: not link.held)
        assert len(told) == 1


def test_a_port_in_use_and_an_unknown_host_are_told() -> None:
    with _bound() as taken:
        with pytest.raises(PeerError, match="cannot listen here: Address already in use"):
            Relay(Driver({}), taken.getsockname(), ("127.0.0.1", 1), "west", pytest.fail).open()
        with pytest.raises(PeerError, match=r"udp/no\.host\.invalid:1: has no address"):
            Relay(Driver({}), ("127.0.0.1", 0), ("no.host.invalid", 1), "west", pytest.fail).open()
