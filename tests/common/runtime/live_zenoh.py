"""Zenoh networks on loopback for tests, and waiting for what must happen soon."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import zenoh

from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_client, open_router

_SOON_S = 60.0
# what a test puts must not be dropped because a busy machine kept the queue full for more than a millisecond
_PATIENT = ("transport/link/tx/queue/congestion_control/drop/wait_before_drop:3000000",)


def soon(holds: Callable[[], bool]) -> bool:
    """Wait until something holds, for ten seconds at most; tell whether it did."""
    until_s = time.monotonic() + _SOON_S
    while not holds():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.005)
    return True


def settle(*clients: zenoh.Session) -> None:
    """Wait until the clients' routers know what they declared: a question that follows it has been answered."""
    for client in clients:
        for _ in client.liveliness().get("nobody/is/here"):
            pass


@contextmanager
def a_router(endpoint: str, *connect: str) -> Iterator[zenoh.Session]:
    with open_router(
        configure("router", ZenohOptions(listen=[endpoint], connect=connect, cfg=_PATIENT)), endpoint
    ) as session:
        yield session


@contextmanager
def a_client(endpoint: str) -> Iterator[zenoh.Session]:
    session = open_client(
        configure("client", ZenohOptions(connect=[endpoint], cfg=_PATIENT)), lambda: False, lambda: None
    )
    assert session is not None
    with session:
        yield session


@dataclass(frozen=True)
class Network:
    """A router and a client of it."""

    router: zenoh.Session
    client: zenoh.Session


@contextmanager
def a_network() -> Iterator[Network]:
    endpoint, _ = free_endpoints()
    with a_router(endpoint) as router, a_client(endpoint) as client:
        yield Network(router, client)
