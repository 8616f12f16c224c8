"""A bridge between two networks on loopback, with a client on each side."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from typing import Any, get_args

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client
from tis.common.channels import Direction, Network
from tis.common.node import Record
from tis.common.runtime.clock import WallClock
from tis.common.runtime.ports import free_endpoints, free_ports
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_router
from tis.common.scenario.network import NetworkPart
from tis.netem.bridge.applications import Applications
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.carried_network import backlog_bytes, stream_network
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.gate import Gate
from tis.netem.bridge.keys import crossing_keys
from tis.netem.bridge.mirrors.queries import QueryTargetName
from tis.netem.bridge.proxy import Address, Proxy
from tis.netem.bridge.sides import lister_config
from tis.netem.build import build_links

_ENDLESS_NS = 1 << 62


class Forgetful:
    def record(self, record: Record) -> None:
        """Keep nothing."""

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        """Keep nothing."""


@dataclass
class Bridged:
    """A bridge at work and its two sides."""

    west: zenoh.Session
    east: zenoh.Session
    endpoints: dict[Network, str]
    sessions: dict[Network, zenoh.Session]
    bridge: Bridge
    applications: Applications
    leaks: list[str] = field(default_factory=list)


@contextmanager
def driving(driver: Driver) -> Iterator[None]:
    """Let packets pass, and release them from a thread, during the block; raise what failed at its end."""
    over = threading.Event()
    driver.start(WallClock(time.monotonic_ns()))
    thread = threading.Thread(target=driver.run, args=(Forgetful(), _ENDLESS_NS, over.is_set))
    thread.start()
    try:
        yield
    finally:
        over.set()
        driver.wake()
        thread.join()
    if driver.error is not None:
        raise driver.error


@contextmanager
def carrying(target: Address, segment_bytes: int = 65_536, **network: Any) -> Iterator[tuple[Driver, Proxy, Address]]:
    """Carry the connections to an address of ours to ``target`` during the block."""
    part = NetworkPart.model_validate(network)
    links = build_links(stream_network(part, "test"), ["**"], 3, None, "test", own_connections=True)
    driver = Driver(links)
    address = ("127.0.0.1", free_ports(1)[0])
    proxy = Proxy(driver, address, target, "west", backlog_bytes(part), segment_bytes, pytest.fail)
    with driving(driver):
        proxy.open()
        try:
            yield driver, proxy, address
        finally:
            proxy.close()


def n_open(there: Bridged) -> int:
    """How many queries are under way."""
    return len(there.applications.queries._open)


def n_mirrored(there: Bridged) -> int:
    """How many queryables are mirrored now, one by one."""
    mirrors = tuple(there.applications.queryables._mirrors.values())
    return sum(mirror.listed for of_one in mirrors for mirror in tuple(of_one.values()))


def n_tokens(there: Bridged) -> int:
    """How many tokens are mirrored now."""
    return sum(len(state.mirrors) for state in there.applications.tokens._states.values())


def delays(delay_ms: float) -> dict[str, Any]:
    pipeline = {"delay": {"kind": "constant", "delay_ms": delay_ms}}
    return {"forward": pipeline, "feedback": pipeline}


@contextmanager
def two_routers() -> Iterator[tuple[dict[Network, zenoh.Session], dict[Network, str]]]:
    west, east = free_endpoints()
    endpoints: dict[Network, str] = {"west": west, "east": east}
    with ExitStack() as stack:
        sessions: dict[Network, zenoh.Session] = {}
        for network, endpoint in endpoints.items():
            config = configure("router", ZenohOptions(listen=[endpoint]))
            sessions[network] = stack.enter_context(open_router(config, endpoint))
        yield sessions, endpoints


@contextmanager
def bridging(
    sessions: dict[Network, zenoh.Session],
    endpoints: dict[Network, str],
    keys: Sequence[str] = ("**",),
    lease_s: float = 2.0,
    time_out_s: float = 5.0,
    probes: bool = True,
    ways: Mapping[Network, str] | None = None,
    query_target: QueryTargetName = "best_matching",
    **network: Any,
) -> Iterator[Bridged]:
    """Bridge two sessions for the length of the block; what failed in a callback is raised at its end.

    ``ways`` lead those that list queryables to the networks; by default they are the endpoints.
    """
    crossing = crossing_keys(keys)
    part = NetworkPart.model_validate(network)
    gates = {direction: Gate(lease_s) for direction in get_args(Direction)} if part.pushes_back else {}
    bridge = Bridge(sessions, build_links(part, crossing.all, 7, {}, "test"), gates)
    leaks: list[str] = []
    listers = {
        network: lister_config(ZenohOptions(connect=[way]))
        for network, way in (endpoints if ways is None else ways).items()
    }
    applications = Applications(
        bridge, sessions, crossing, lease_s, leaks.append, time_out_s, listers=listers, query_target=query_target
    )
    with ExitStack() as stack:
        west = stack.enter_context(a_client(endpoints["west"]))
        east = stack.enter_context(a_client(endpoints["east"]))
        stack.callback(bridge.close)
        stack.callback(applications.close)
        if probes:
            applications.refuse_leaks()
        applications.open()
        with driving(bridge):
            yield Bridged(west, east, endpoints, sessions, bridge, applications, leaks)


@contextmanager
def a_bridge(**options: Any) -> Iterator[Bridged]:
    with two_routers() as (sessions, endpoints), bridging(sessions, endpoints, probes=False, **options) as bridged:
        yield bridged
