"""The emulator of a byte stream: between the two ends of TCP connections, until Ctrl-C.

In its network what needs messages is refused, and an outage holds bytes up, not off.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Final, NamedTuple, get_args

from tis.common.channels import Direction, Network
from tis.common.errors import EXIT_OK, Fault, InputError, PeerError
from tis.common.runtime.process import Interrupt, command_line
from tis.common.runtime.scenario_files import load_traces
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_session import configure, open_router
from tis.common.scenario.network import Buffer, NetworkPart
from tis.common.scenario.network.capacity import CoDel, PriorityQueue, Rate, RecordedRate, TailDrop
from tis.common.scenario.network.conditions import Change, State
from tis.common.scenario.network.pipeline import Stages
from tis.common.scenario.reading import Profiles
from tis.common.zenoh_syntax import is_local
from tis.netem.bridge.control import attach
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.proxy import Address, Proxy
from tis.netem.bridge.sides import Place
from tis.netem.bridge.standalone import Standalone, drive, lines_on_the_network, open_log, start, tell
from tis.netem.bridge.standstill import Deadline
from tis.netem.bridge.tally import Tally, table, watches
from tis.netem.build import build_links

_SEGMENT_BYTES: Final = 1448
_CHUNK_BYTES: Final = 65_536
_ENDPOINT: Final = re.compile(r"(tcp|tls)/(\[[^\]]+\]|[^/:]+):(\d+)([?#].*)?")
_KEYS: Final = ("**",)
_RULE: Final = "needs messages: a stream of bytes (--carry tcp) loses, copies, alters and reorders nothing"
_MESSAGES: Final = ("loss", "duplicate", "corrupt", "reorder")
_DEFAULT_BYTES: Final = 4_000_000
_PACKET_BYTES: Final = 1500
_UNBOUNDED: Final = TailDrop(kind="tail_drop", max_packets=1_000_000_000, max_bytes=None)
_ROOMY: Final = Buffer(max_packets=10_000_000, max_mb=1_000_000)


class Ends(NamedTuple):
    """Where connections come from, where they go, and the network of the former."""

    listen: Address
    connect: Address
    comes_from: Network


def run_carrying(options: Standalone, status: Status, library: Profiles | None) -> int:
    """Carry connections until an interrupt or the end of the duration; return the exit code.

    Raises `InputError`, `DataError` and `PeerError`. Control, if asked for, is answered on an endpoint of its own.
    """
    ends, network = _checked(options)
    backlog = backlog_bytes(options.network)  # as asked for: what crosses as a stream has no bound
    options = replace(options, network=network, keys=_KEYS)
    traces = load_traces(network)
    links = build_links(network, _KEYS, options.seed, traces, options.where)
    interrupt = Interrupt()
    with ExitStack() as stack:
        stack.enter_context(interrupt.installed())
        deadline = Deadline(lambda text: status.failed(PeerError.exit_code, [text]))
        stack.enter_context(deadline.installed())
        driver = Driver(links)
        interrupt.wakers.append(driver.wake)
        segment_bytes = _SEGMENT_BYTES if has_rate(network) else _CHUNK_BYTES
        proxy = Proxy(driver, *ends, backlog, segment_bytes, status.warning)
        driver.also_counts.append(proxy.counters)
        if options.control is not None:
            config = configure("router", replace(options.zenoh, listen=(options.control,)))
            session = stack.enter_context(open_router(config, options.control))
            stack.callback(attach(driver, {ends.comes_from: session}, options.prefix, library, stream_change))
        tally = Tally(open_log(options), status.warning, *watches(links, network.buffer, status.warning))
        clock = start(driver)
        proxy.open()
        stack.callback(proxy.close)
        for line in [*_lines(options, ends), *lines_on_the_network(options, traces)]:
            tell(line)
        drive(driver, tally, clock, options, interrupt, deadline)
        proxy.close()
        counters = driver.counters()
    for line in [*table(counters, tally.errors), _bytes_carried(counters)]:
        print(line, flush=True)  # noqa: T201  (standard output is for the result)
    return EXIT_OK


def _checked(options: Standalone) -> tuple[Ends, NetworkPart]:
    """Return the ends and the network of the stream; raises `InputError` with all faults."""
    faults: list[Fault] = []
    if tuple(options.keys) != _KEYS:
        rule = "must not be given with --carry tcp, which reads no keys"
        faults.append(Fault("netem", "KEYEXPR", rule, " ".join(options.keys)))
    ends: Ends | None = None
    network: NetworkPart | None = None
    try:
        ends = ends_of(options.places)
    except InputError as error:
        faults += error.faults
    if ends is not None and not (options.zenoh.insecure or is_local(_endpoint(ends.listen))):
        # what is carried is not read, so netem asks nobody for a certificate or a password
        rule = "must be on loopback with --carry tcp, unless --insecure says that anybody may connect"
        faults.append(Fault("netem", f"--{ends.comes_from}", rule, _endpoint(ends.listen)))
    try:
        network = stream_network(options.network, options.where)
    except InputError as error:
        faults += error.faults
    if faults or ends is None or network is None:
        raise InputError(faults)
    return ends, network


def ends_of(places: Mapping[Network, Place]) -> Ends:
    """Return the ends of the connections; raises `InputError` unless one network listens and the other is called."""
    listening = [network for network, place in places.items() if place.listen]
    calling = [network for network, place in places.items() if place.connect]
    endpoints = [endpoint for place in places.values() for endpoint in (*place.listen, *place.connect)]
    rule = "must be --west and --connect-east, or --east and --connect-west, one endpoint each, with --carry tcp"
    if len(listening) != 1 or len(calling) != 1 or listening == calling or len(endpoints) != len(places):
        raise InputError(Fault("netem", "endpoints", rule, " ".join(endpoints) or None))
    listen, connect = places[listening[0]].listen[0], places[calling[0]].connect[0]
    faults = [
        Fault("netem", option, "must read tcp/HOST:PORT or tls/HOST:PORT with --carry tcp", endpoint)
        for option, endpoint in ((f"--{listening[0]}", listen), (f"--connect-{calling[0]}", connect))
        if _ENDPOINT.fullmatch(endpoint) is None
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
        f"carrying the bytes of TCP connections from {ends.comes_from} (listening on {_shown(ends.listen)}) "
        f"to {other} (at {_shown(ends.connect)}), unread"
    ]
    if options.network.from_profile is not None:
        lines.append(f"from profile {options.network.from_profile}")
    if options.control is not None:
        lines.append(f"control: {command_line(['net', 'show', '--connect', options.control])}")
    return lines


def _shown(address: Address) -> str:
    return f"{address[0]}:{address[1]}"


def _bytes_carried(counters: Mapping[str, int]) -> str:
    carried = ", ".join(f"{counters[f'carry.{way}.bytes']} bytes {way}" for way in get_args(Direction))
    unanswered, withdrawn = counters["carry.unanswered"], counters["carry.shared_memory_withdrawn"]
    return f"{counters['carry.connections']} connections, {carried}; each packet above is a piece of a stream" + (
        (f"; {unanswered} connections found nobody at the other end" if unanswered else "")
        + (f"; {withdrawn} offers of shared memory, which passes netem, were withdrawn" if withdrawn else "")
    )


def stream_network(network: NetworkPart, where: str) -> NetworkPart:
    """Return the network as it acts on bytes; raises `InputError` with every part that needs messages.

    An outage becomes a stall: TCP repeats what it loses, so nothing arrives until the outage ends. Nothing may be
    dropped, so queues have no bound; `backlog_bytes` holds the sender back instead.
    """
    faults = (
        [Fault(where, "rules", "cannot be told apart in a stream of bytes (--carry tcp)")] if network.rules else []
    )
    changed: dict[str, Any] = {"buffer": _ROOMY, "unmatched": "refuse"}
    for direction in get_args(Direction):
        pipeline = getattr(network, direction)
        faults += _faults(where, direction, pipeline)
        changed[direction] = pipeline.model_copy(update=_unbounded(pipeline))
    for field, change in _changes(network):
        faults += _faults(where, field, change)
    if faults:
        raise InputError(faults)
    changed["outages"] = tuple(part.model_copy(update={"effect": "stall"}) for part in network.outages)
    changed["timeline"] = tuple(entry.model_copy(update={"set": _on_bytes(entry.set)}) for entry in network.timeline)
    if network.states is not None:
        states = tuple(_state(state) for state in network.states.states)
        changed["states"] = network.states.model_copy(update={"states": states})
    return network.model_copy(update=changed)


def stream_change(change: Change) -> Change:
    """Return a change that was asked for live, as it acts on bytes; raises `InputError`."""
    faults = _faults("control", "change", change)
    if faults:
        raise InputError(faults)
    return _on_bytes(change)


def backlog_bytes(network: NetworkPart) -> Mapping[Direction, int]:
    """Return how many bytes each direction takes from senders before it makes them wait.

    These are the bounds of the direction's queue, as far as it has one.
    """
    return {direction: _bound(getattr(network, direction).rate) for direction in get_args(Direction)}


def has_rate(network: NetworkPart) -> bool:
    """Tell whether a rate holds at some time, so that bytes have to be sent in segments."""
    pipelines = (network.forward, network.feedback)
    return any(stages.rate is not None for stages in (*pipelines, *(change for _, change in _changes(network))))


def _bound(rate: Rate | RecordedRate | str | None) -> int:
    if not isinstance(rate, Rate | RecordedRate):
        return _DEFAULT_BYTES
    of_packets = rate.queue.max_packets * _PACKET_BYTES
    return max(_PACKET_BYTES, of_packets if rate.queue.max_bytes is None else min(of_packets, rate.queue.max_bytes))


def _changes(network: NetworkPart) -> Iterator[tuple[str, Change]]:
    for i, entry in enumerate(network.timeline):
        yield f"timeline.{i}.set", entry.set
    for i, state in enumerate(() if network.states is None else network.states.states):
        for direction in get_args(Direction):
            yield f"states.states.{i}.{direction}", getattr(state, direction)


def _faults(where: str, field: str, stages: Stages) -> list[Fault]:
    names = [name for name in _MESSAGES if getattr(stages, name) is not None]
    if getattr(stages, "ordering", None) not in (None, "fifo"):
        names.append("ordering")
    if getattr(stages, "add_p_loss", 0.0) > 0.0:
        names.append("add_p_loss")
    if isinstance(stages.rate, Rate | RecordedRate) and isinstance(stages.rate.queue, CoDel | PriorityQueue):
        names.append("rate.queue")
    return [Fault(where, f"{field}.{name}", _RULE) for name in names]


def _unbounded(stages: Stages) -> dict[str, Any]:
    rate = stages.rate
    return {"rate": rate.model_copy(update={"queue": _UNBOUNDED})} if isinstance(rate, Rate | RecordedRate) else {}


def _on_bytes(change: Change) -> Change:
    update = _unbounded(change)
    if change.outage:
        update |= {"outage": False, "stall": True}
    return change.model_copy(update=update) if update else change


def _state(state: State) -> State:
    return state.model_copy(update={way: _on_bytes(getattr(state, way)) for way in get_args(Direction)})
