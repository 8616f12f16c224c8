"""The emulator of what is carried unread: of TCP connections or of UDP datagrams, until Ctrl-C."""

import re
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple, get_args

import zenoh

from tis.common.channels import Direction, Network
from tis.common.errors import EXIT_OK, Fault, InputError, PeerError
from tis.common.runtime.connections import closing
from tis.common.runtime.process import Interrupt, command_line
from tis.common.runtime.scenario_files import load_traces
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_session import configure, open_router
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.reading import Profiles
from tis.common.zenoh_syntax import is_local
from tis.netem.bridge.carried_network import (
    backlog_bytes,
    datagram_change,
    datagram_network,
    needs_segments,
    stream_change,
    stream_network,
)
from tis.netem.bridge.control import attach
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.proxy import Address, Proxy
from tis.netem.bridge.relay import Relay
from tis.netem.bridge.revocation import watch_revoked
from tis.netem.bridge.sides import Place
from tis.netem.bridge.standalone import Carriage, Standalone, drive, lines_on_the_network, start, tell
from tis.netem.bridge.standalone_log import open_log
from tis.netem.bridge.standstill import Deadline
from tis.netem.bridge.tally import Tally, table
from tis.netem.bridge.watches import watches
from tis.netem.build import build_links
from tis.netem.expected.synopsis import synopsis

_SEGMENT_BYTES: Final = 1448
_CHUNK_BYTES: Final = 65_536
_ENDPOINT: Final = re.compile(r"(\w+)/(\[[^\]]+\]|[^/:]+):(\d+)([?#].*)?")
_KEYS: Final = ("**",)


class _Kind(NamedTuple):
    """What is carried: the protocols of its endpoints, what it is called, and the network as it acts on it."""

    protocols: tuple[str, str]
    name: str
    network: Callable[[NetworkPart, str], NetworkPart]
    change: Callable[[NetworkPart, Change], Change]


_KINDS: Final[Mapping[Carriage, _Kind]] = {
    "tcp": _Kind(("tcp", "tls"), "the bytes of TCP connections", stream_network, stream_change),
    "udp": _Kind(("udp", "quic"), "UDP datagrams", datagram_network, datagram_change),
}

_ASIDES: Final = {
    "carry.unanswered": "connections found nobody at the other end",
    "carry.shared_memory_withdrawn": "offers of shared memory, which passes netem, were withdrawn",
    "carry.refused": "datagrams of clients without a place did not cross: not part of the configured network",
    "carry.overrun": "datagrams came faster than netem reads them: not part of the configured network",
    "carry.unsent": "datagrams could not be sent",
}


class Ends(NamedTuple):
    """Where connections or datagrams come from, where they go, and the network of the former."""

    listen: Address
    connect: Address
    comes_from: Network


def run_carrying(options: Standalone, status: Status, library: Profiles | None) -> int:
    """Carry connections or datagrams until an interrupt or the end of the duration; return the exit code.

    Raises `InputError`, `DataError` and `PeerError`. Control, if asked for, is answered on an endpoint of its own.
    """
    ends, network = _checked(options)
    asked, options = options.network, replace(options, network=network, keys=_KEYS)
    traces = load_traces(network)
    links = build_links(network, _KEYS, options.seed, traces, options.where, own_connections=options.carry == "tcp")
    interrupt = Interrupt()
    with ExitStack() as stack:
        stack.enter_context(interrupt.installed())
        deadline = Deadline(lambda text: status.failed(PeerError.exit_code, [text]))
        stack.enter_context(deadline.installed())
        driver = Driver(links)
        interrupt.wakers.append(driver.wake)
        carrier = _carrier(options, driver, ends, asked, status)
        driver.also_counts.append(carrier.counters)
        sessions: dict[Network, zenoh.Session] = {}
        if options.control is not None:
            config = configure("router", replace(options.zenoh, listen=(options.control,)))
            sessions[ends.comes_from] = stack.enter_context(closing(open_router(config, options.control), config))
            watch_revoked(stack, options.zenoh, None, sessions, [options.control], status.warning)
        log = open_log(options.log_dir, options.network, options.seed, options.keys)
        tally = Tally(log, status.warning, *watches(links, network.buffer, status.warning))
        if sessions:
            adapt = partial(_KINDS[options.carry].change, asked)
            stack.callback(attach(driver, sessions, options.prefix, library, adapt, delays=tally.recent))
        lines = [*_lines(options, ends), *lines_on_the_network(options, traces)]  # before anything waits for them
        clock = start(driver)
        carrier.open()
        stack.callback(carrier.close)
        tell(*lines)
        drive(driver, tally, clock, options, interrupt, deadline)
        carrier.close()
        counters = driver.counters()
    asked_for = synopsis(options.network, traces)
    for line in [*table(counters, tally, asked_for), _carried(counters)]:
        print(line, flush=True)  # noqa: T201  (standard output is for the result)
    return EXIT_OK


def _carrier(options: Standalone, driver: Driver, ends: Ends, asked: NetworkPart, status: Status) -> Proxy | Relay:
    """Return what carries; ``asked`` still has the bounds of queues, which a stream no longer has."""
    if options.carry == "udp":
        return Relay(driver, *ends, status.warning)
    segment_bytes = _SEGMENT_BYTES if needs_segments(options.network) else _CHUNK_BYTES
    return Proxy(driver, *ends, backlog_bytes(asked), segment_bytes, status.warning)


def _checked(options: Standalone) -> tuple[Ends, NetworkPart]:
    """Return the ends and the network of what is carried; raises `InputError` with all faults."""
    faults: list[Fault] = []
    if tuple(options.keys) != _KEYS:
        rule = f"must not be given with --carry {options.carry}, which reads no keys"
        faults.append(Fault("netem", "KEYEXPR", rule, " ".join(options.keys)))
    ends: Ends | None = None
    network: NetworkPart | None = None
    try:
        ends = ends_of(options.places, options.carry)
    except InputError as error:
        faults += error.faults
    if ends is not None and not (options.zenoh.insecure or is_local(_endpoint(ends.listen))):
        # what is carried is not read, so netem asks nobody for a certificate or a password
        rule = f"must be on loopback with --carry {options.carry}, unless --insecure says that anybody may connect"
        (endpoint,) = options.places[ends.comes_from].listen
        faults.append(Fault("netem", f"--{ends.comes_from}", rule, endpoint))
    try:
        network = _KINDS[options.carry].network(options.network, options.where)
    except InputError as error:
        faults += error.faults
    if faults or ends is None or network is None:
        raise InputError(faults)
    return ends, network


def ends_of(places: Mapping[Network, Place], carry: Carriage) -> Ends:
    """Return the ends of what is carried; raises `InputError` unless one network listens and the other is called."""
    listening = [network for network, place in places.items() if place.listen]
    calling = [network for network, place in places.items() if place.connect]
    endpoints = [endpoint for place in places.values() for endpoint in (*place.listen, *place.connect)]
    rule = f"must be --west and --connect-east, or --east and --connect-west, one endpoint each, with --carry {carry}"
    if len(listening) != 1 or len(calling) != 1 or listening == calling or len(endpoints) != len(places):
        raise InputError(Fault("netem", "endpoints", rule, " ".join(endpoints) or None))
    listen, connect = places[listening[0]].listen[0], places[calling[0]].connect[0]
    protocols = _KINDS[carry].protocols
    forms = " or ".join(f"{protocol}/HOST:PORT" for protocol in protocols)
    faults = [
        Fault("netem", option, f"must read {forms} with --carry {carry}", endpoint)
        for option, endpoint in ((f"--{listening[0]}", listen), (f"--connect-{calling[0]}", connect))
        if (form := _ENDPOINT.fullmatch(endpoint)) is None or form[1] not in protocols
    ]
    if faults:
        raise InputError(faults)
    return Ends(_address(listen), _address(connect), listening[0])


def _address(endpoint: str) -> Address:
    found = _ENDPOINT.fullmatch(endpoint)
    assert found is not None
    return found[2].strip("[]"), int(found[3])


def _endpoint(address: Address) -> str:
    host, port = address
    return f"tcp/[{host}]:{port}" if ":" in host else f"tcp/{host}:{port}"


def _lines(options: Standalone, ends: Ends) -> list[str]:
    other = next(network for network in get_args(Network) if network != ends.comes_from)
    lines = [
        f"carrying {_KINDS[options.carry].name} from {ends.comes_from} (listening on {_shown(ends.listen)}) "
        f"to {other} (at {_shown(ends.connect)}), unread"
    ]
    if options.network.from_profile is not None:
        lines.append(f"from profile {options.network.from_profile}")
    if options.control is not None:
        lines.append(f"control: {command_line(['net', 'show', '--connect', options.control])}")
    return lines


def _shown(address: Address) -> str:
    return f"{address[0]}:{address[1]}"


def _carried(counters: Mapping[str, int]) -> str:
    """Return the line on what was carried."""
    n_bytes = ", ".join(f"{counters[f'carry.{way}.bytes']} bytes {way}" for way in get_args(Direction))
    if "carry.clients" in counters:
        first = f"{counters['carry.clients']} clients, {n_bytes}; each packet above is a datagram"
    else:
        first = f"{counters['carry.connections']} connections, {n_bytes}; each packet above is a piece of a stream"
    asides = [f"{counters[name]} {text}" for name, text in _ASIDES.items() if counters.get(name)]
    return "; ".join([first, *asides])
