"""The valve between two sockets: what comes through, and what has to wait."""

import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from tests.common.runtime.live_zenoh import soon
from tis.netem.bridge.mirrors.lister import Valve, valve_to

pytestmark = pytest.mark.live


@contextmanager
def a_valve() -> Iterator[tuple[Valve, socket.socket, socket.socket]]:
    """Give a valve and what its two ends are connected to: the router, and the client."""
    (near_router, router), (near_client, client) = socket.socketpair(), socket.socketpair()
    with router, client:
        router.settimeout(3.0)
        client.settimeout(3.0)
        yield Valve(near_router, near_client), router, client


def test_it_carries_both_ways_and_ends_with_either() -> None:
    with a_valve() as (_, router, client):
        router.sendall(b"from the router")
        client.sendall(b"from the client")
        assert client.recv(100) == b"from the router"
        assert router.recv(100) == b"from the client"
        router.close()
        assert client.recv(100) == b""


def test_closed_it_keeps_back_what_the_router_says_and_only_that() -> None:
    with a_valve() as (valve, router, client):
        with valve.closed():
            router.sendall(b"later")
            client.sendall(b"now")
            assert router.recv(100) == b"now"
            client.settimeout(0.1)
            with pytest.raises(TimeoutError):
                client.recv(100)
        client.settimeout(3.0)
        assert client.recv(100) == b"later"


def test_it_closes_once_the_client_has_taken_what_it_was_given() -> None:
    with a_valve() as (valve, router, client):
        router.sendall(b"first")
        assert client.recv(1) == b"f"  # so it is underway, and the rest not taken
        closed, may_open = threading.Event(), threading.Event()

        def close() -> None:
            with valve.closed():
                closed.set()
                may_open.wait(3.0)

        thread = threading.Thread(target=close)
        thread.start()
        assert not closed.wait(0.1)
        assert client.recv(100) == b"irst"
        assert closed.wait(3.0)
        may_open.set()
        thread.join()


def test_a_client_that_stands_still_does_not_hold_up_the_router() -> None:
    with a_valve() as (_, router, client):
        router.sendall(bytes(8_000_000))  # far more than the sockets hold: it would time out
        taken = 0
        while taken < 8_000_000:
            taken += len(client.recv(1 << 20))


def test_it_leads_to_the_first_router_that_answers() -> None:
    with socket.create_server(("127.0.0.1", 0)) as router, socket.socket(socket.AF_UNIX) as client:
        port = router.getsockname()[1]
        with valve_to(["unixsock-stream//nobody/here", f"tcp/127.0.0.1:{port}"]) as way:
            assert way is not None
            client.connect(way[0].removeprefix("unixsock-stream/"))
            assert soon(lambda: len(way[1]) == 1)
        client.sendall(b"hello")
        with router.accept()[0] as taken:
            assert taken.recv(100) == b"hello"


@pytest.mark.parametrize("endpoint", ["tls/host:7447", "tcp/host:7447#iface=eth0", "udp/host:7447"])
def test_there_is_none_where_the_way_is_no_plain_socket(endpoint: str) -> None:
    with valve_to(["tcp/127.0.0.1:1", endpoint]) as way:
        assert way is None


def test_without_a_router_there_is_no_way() -> None:
    with pytest.raises(OSError, match="No such file"), valve_to(["unixsock-stream//nobody/here"]):
        pass
