"""The emulator without a scenario: between any two Zenoh networks, until Ctrl-C."""

import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

import zenoh

from tis.common.channels import Direction, Network
from tis.common.errors import EXIT_INTERRUPTED, EXIT_INVALID_RUN, EXIT_OK, DataError, Fault, InputError, PeerError
from tis.common.runtime.clock import WallClock
from tis.common.runtime.memory import share_arenas
from tis.common.runtime.process import Interrupt
from tis.common.runtime.processor_watch import ProcessorWatch
from tis.common.runtime.recorder import ThreadedRecorder
from tis.common.runtime.running import ALONE, Running, announced
from tis.common.runtime.scenario_files import load_traces
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.reading import Profiles
from tis.common.trace import Trace
from tis.common.units import s_to_ns
from tis.netem.bridge.applications import Applications
from tis.netem.bridge.audit import AuditTrail
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.bypass import refuse_one_router
from tis.netem.bridge.control import attach
from tis.netem.bridge.driver import Driver
from tis.netem.bridge.gate import gates_for, without_gates
from tis.netem.bridge.keys import CrossingKeys, crossing_keys
from tis.netem.bridge.mirrors.queries import TIME_OUT_S, QueryTargetName
from tis.netem.bridge.overhead import warn_of_overhead
from tis.netem.bridge.revocation import watch_revoked
from tis.netem.bridge.sides import (
    ClientMode,
    Place,
    check_options,
    check_places,
    lease_s,
    lister_configs,
    open_private_endpoints,
    open_sides,
    scout_config,
)
from tis.netem.bridge.standalone_log import open_log
from tis.netem.bridge.standstill import Deadline
from tis.netem.bridge.tally import Tally, table
from tis.netem.bridge.watches import RulesWatch, silent, watches
from tis.netem.build import build_links
from tis.netem.expected.synopsis import synopsis
from tis.netem.link.link import Link

_ENDLESS_NS: Final = 1 << 62
_EVERYTHING: Final = ("**",)

Carriage = Literal["messages", "tcp", "udp"]


@dataclass(frozen=True)
class Standalone:
    """The options of ``tis netem`` without a scenario."""

    places: Mapping[Network, Place]
    network: NetworkPart
    keys: Sequence[str] = _EVERYTHING
    where: str = "netem"
    seed: int = 0
    zenoh: ZenohOptions = field(default_factory=ZenohOptions)
    mode: ClientMode = "client"
    duration_s: float | None = None
    wait_s: float | None = None
    log_dir: Path | None = None
    summarize: bool = False
    """Whether the log is summarized at the end."""
    query_time_out_s: float = TIME_OUT_S
    query_target: QueryTargetName = "best_matching"
    prefix: str = "tis"
    carry: Carriage = "messages"
    control: str | None = None
    """Endpoint on which control is answered where netem has no session of its own: ``carry`` tcp or udp."""


def run_standalone(options: Standalone, status: Status, library: Profiles | None) -> int:
    """Bridge the two networks until an interrupt or the end of the duration; return the exit code.

    ``library`` finds profiles that live control requests. Raises `InputError`, `DataError` and `PeerError`. Nothing
    passes before the impairments are in force.
    """
    # Stage 1: all that can fail without a network, before any endpoint opens.
    crossing = _checked(options)
    # no wildcard matches a chunk that begins with @: such keys cross when they are named
    passes = options.network.unmatched == "pass"
    listening = crossing_keys((*_EVERYTHING, *options.keys)) if passes else crossing
    traces = load_traces(options.network)
    links = _links(options, crossing.all, traces)
    lines = _first_lines(options, traces)
    share_arenas()
    gates, zenoh_options = gates_for(options.network, lease_s(options.zenoh), options.zenoh)
    interrupt = Interrupt()
    with ExitStack() as stack:
        stack.enter_context(interrupt.installed())
        deadline = Deadline(lambda text: status.failed(PeerError.exit_code, [text]))
        stack.enter_context(deadline.installed())
        until_s = None if options.wait_s is None else time.monotonic() + options.wait_s

        def stopped() -> bool:
            return interrupt.requested or (until_s is not None and time.monotonic() > until_s)

        audit = _audit(stack, options, status)
        private = open_private_endpoints(stack, options.places, options.zenoh)
        # Stage 2: the sessions, then every listener, closed in the reverse order.
        sessions = open_sides(stack, options.places, zenoh_options, options.mode, stopped, status.waiting, private)
        if sessions is None:
            if interrupt.requested:
                return EXIT_INTERRUPTED
            raise PeerError(Fault("netem", "zenoh", f"no network answered within {options.wait_s} s"))
        refuse_one_router(sessions)
        _watch(stack, options, sessions, audit, status)
        bridge = Bridge(sessions, links, gates)
        interrupt.wakers.append(bridge.wake)
        stack.callback(bridge.close)
        listers = lister_configs(options.places, options.zenoh, private, sessions)
        applications = Applications(
            bridge, sessions, listening, lease_s(options.zenoh), status.warning, options.query_time_out_s,
            scout_config(options.zenoh), listers, options.query_target, audit.gossip, status.bypass,
        )  # fmt: skip
        stack.callback(applications.close)
        applications.refuse_leaks()
        bridge.base_overhead_ns = _base_overhead_ns(options, sessions, traces, status)
        applications.open()
        tally = _tally(options, links, status, audit)
        adapt = None if gates else without_gates
        stack.callback(attach(bridge, sessions, options.prefix, library, adapt, audit, tally.recent))
        clock = start(bridge, audit, options.log_dir)  # stage 3: from here on packets pass
        stack.enter_context(announced(Running(**_ends(options), session=options.prefix, title=ALONE)))
        tell(*lines)
        drive(bridge, tally, clock, options, interrupt, deadline)
        applications.close()
        counters = bridge.counters()
    for line in _last_lines(options, counters, tally, traces):
        print(line, flush=True)  # noqa: T201  (standard output is for the result)
    return EXIT_INVALID_RUN if applications.n_leaks else EXIT_OK


def _links(options: Standalone, keys: Sequence[str], traces: Mapping[str, Trace]) -> dict[Direction, Link]:
    links = build_links(options.network, keys, options.seed, traces, options.where)
    for link in links.values():
        link.prepare(options.keys)
    return links


def _audit(stack: ExitStack, options: Standalone, status: Status) -> AuditTrail:
    listen = [(network, one) for network, place in options.places.items() for one in place.listen]
    return AuditTrail.opened(stack, listen, status.warning, refusals=options.log_dir is not None)


def _watch(
    stack: ExitStack,
    options: Standalone,
    sessions: Mapping[Network, zenoh.Session],
    audit: AuditTrail,
    status: Status,
) -> None:
    """Note who connects, and cut off whose name is revoked, until ``stack`` closes."""
    audit.watch(stack, sessions)
    listen = [endpoint for place in options.places.values() for endpoint in place.listen]
    watch_revoked(stack, options.zenoh, audit, sessions, listen, status.warning)


def _tally(options: Standalone, links: Mapping[Direction, Link], status: Status, audit: AuditTrail) -> Tally:
    looks = watches(links, options.network.buffer, status.warning)
    log = open_log(options.log_dir, options.network, options.seed, options.keys)
    rules = RulesWatch({direction: link.rules for direction, link in links.items()})
    return Tally(log, status.warning, *looks, audit=audit, rules=rules)


def _base_overhead_ns(
    options: Standalone, sessions: Mapping[Network, zenoh.Session], traces: Mapping[str, Trace], status: Status
) -> int:
    """Return netem's own delay, and warn where it is long for the network asked for."""
    return warn_of_overhead(sessions, _ends(options), options.zenoh, options.network, traces, status)


def _ends(options: Standalone) -> dict[Network, str]:
    """Return an endpoint at which each network is reached."""
    return {network: (*place.listen, *place.connect)[0] for network, place in options.places.items()}


def start(bridge: Driver, audit: AuditTrail | None = None, folder: Path | None = None) -> WallClock:
    """Let packets pass, and write the audit log to ``folder``; return the clock, whose zero is now."""
    bridge.settle()
    clock = WallClock(time.monotonic_ns())
    bridge.start(clock)
    if audit is not None:
        audit.begin(folder, clock)
    return clock


def _checked(options: Standalone) -> CrossingKeys:
    """Return the keys that cross; raises `InputError` with all faults of endpoints and keys."""
    found: list[Fault] = []
    checks: tuple[Callable[[], object], ...] = (
        lambda: check_places(options.places),
        lambda: check_options(options.zenoh),
        lambda: crossing_keys(options.keys),
    )
    for check in checks:
        try:
            check()
        except InputError as error:
            found += error.faults
    if found:
        raise InputError(found)
    return crossing_keys(options.keys)


def drive(
    bridge: Driver, tally: Tally, clock: WallClock, options: Standalone, interrupt: Interrupt, deadline: Deadline
) -> None:
    """Release what crosses until the interrupt or the end of the duration, and complete the log.

    From then on, or from an error on, the deadline runs: only closing is left.
    """
    deadline.progress = lambda: tally.n_records
    note = {"epoch_monotonic_ns": clock.epoch_ns, "epoch_unix_ns": clock.unix_epoch_ns()}
    tally.attach("clock.json", json.dumps(note).encode())
    recorder = ThreadedRecorder(tally)
    processors = ProcessorWatch(clock)
    until_ns = _ENDLESS_NS if options.duration_s is None else s_to_ns(options.duration_s)
    try:
        bridge.run(recorder, until_ns, lambda: interrupt.requested)
    finally:
        recorder.record(processors.record())
        recorder.close()
        deadline.begin()
    if recorder.error is not None:
        reason = f"{recorder.error.strerror}, {recorder.n_dropped} records lost"
        raise DataError(Fault("netem", "log", reason))
    if isinstance(bridge.error, PeerError):
        raise bridge.error
    if bridge.error is not None:
        raise RuntimeError("a Zenoh callback failed") from bridge.error


def _first_lines(options: Standalone, traces: Mapping[str, Trace]) -> list[str]:
    """Return the lines printed at the beginning."""
    profile = options.network.from_profile
    lines = [f"{network}: {place.described(options.mode)}" for network, place in options.places.items()]
    lines.append(f"crossing: {_crossing(options)}")
    if profile is not None:
        lines.append(f"from profile {profile}")
    return [*lines, *lines_on_the_network(options, traces)]


def _last_lines(
    options: Standalone, counters: Mapping[str, int], tally: Tally, traces: Mapping[str, Trace]
) -> list[str]:
    """Return the lines printed at the end."""
    lines = table(counters, tally, synopsis(options.network, traces))
    return lines + silent(counters, _ends(options), options.keys, tally.rules.unmatched)


def lines_on_the_network(options: Standalone, traces: Mapping[str, Trace]) -> list[str]:
    """Return the lines on the network, the log and the end."""
    lines = synopsis(options.network, traces)
    if options.log_dir is None:
        lines.append("not logging: --log, or --run-dir FOLDER, keeps what is decided for every packet")
    else:
        lines.append(f"logging to {options.log_dir / 'netem.mcap'}")
    until = "Ctrl-C ends it" if options.duration_s is None else f"for {options.duration_s:g} s"
    return [*lines, f"running, {until}"]


def _crossing(options: Standalone) -> str:
    """Return the keys that cross, with the graph of ROS 2, which crosses with its domain."""
    graphs = [key for key in crossing_keys(options.keys).tokens if key.startswith("@")]
    along = f" and {', '.join(graphs)}" if graphs else ""
    rest = ", all else clean" if options.network.unmatched == "pass" else ""
    is_all = rest or _EVERYTHING[0] in options.keys
    hidden = (
        "; of keys with a chunk that begins with @ only those named, as no wildcard matches them" if is_all else ""
    )
    return ", ".join(options.keys) + along + rest + hidden


def tell(*lines: str) -> None:
    """Say what the emulator does, on standard error."""
    for line in lines:
        print(f"netem: {line}", file=sys.stderr, flush=True)  # noqa: T201
