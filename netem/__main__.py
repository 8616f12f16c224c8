"""The emulator's process: ``python -m tis.netem SCENARIO`` or ``tis netem SCENARIO``."""

import json
import secrets
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import typer
import zenoh

from tis.common.channels import SIDE_ON, Network, Side
from tis.common.errors import EXIT_INTERRUPTED, Fault, InputError, PeerError
from tis.common.runtime.clock import WallClock, monotonic_ns
from tis.common.runtime.clock_watch import ClockServer
from tis.common.runtime.connections import closing
from tis.common.runtime.control import ControlKeys, Epoch, Presence, boot_digest
from tis.common.runtime.credentials import credentials, expiry_warnings, refuse_plain
from tis.common.runtime.meeting import Meeting, ScenarioExchange, new_meeting
from tis.common.runtime.memory import share_arenas
from tis.common.runtime.peer_watch import Beats, PeerWatch
from tis.common.runtime.process import Interrupt, run_to_end
from tis.common.runtime.scenario_files import load_traces, trace_attachments
from tis.common.runtime.side import Membership, drive
from tis.common.runtime.side_cli import endpoints_for
from tis.common.runtime.side_log import SideOptions, continued, earlier_part, open_log
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_session import ZenohOptions, configure, lease_ms, open_router
from tis.common.scenario import Scenario
from tis.common.scenario.security import Mtls
from tis.common.units import NS_PER_MS
from tis.common.zenoh_syntax import port_of
from tis.netem.bridge.access import access_control
from tis.netem.bridge.applications import Applications
from tis.netem.bridge.audit import AuditTrail
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.command import netem_command
from tis.netem.bridge.control import attach
from tis.netem.bridge.emergency import EmergencyLine
from tis.netem.bridge.gate import gates_for, without_gates
from tis.netem.bridge.keys import crossing_keys
from tis.netem.bridge.overhead import warn_of_overhead
from tis.netem.bridge.renewal import RenewedListeners, with_spares
from tis.netem.bridge.revocation import Revocations
from tis.netem.bridge.sides import lease_s
from tis.netem.bridge.standstill import Deadline
from tis.netem.bridge.tally import WatchedLog
from tis.netem.bridge.watches import watches
from tis.netem.build import build_netem

_LEAD_NS: Final = 150 * NS_PER_MS
_GLANCE_S: Final = 0.5
_LISTEN_MS: Final = 2000
_MAX_MESSAGE_BYTES: Final = 4 << 20
"""Size of a message that the routers of a run put together: a larger one, which no side sends, fills the queue to its
reader, and the thread that waits for it forwards nothing else for seconds."""
_WAIT: Final = zenoh.CongestionControl.BLOCK  # sent once, so a full queue must not drop it

Sessions = Mapping[Network, zenoh.Session]


def run_netem(scenario: Scenario, options: SideOptions, status: Status) -> int:
    """Bridge the two networks until the end of the run; return the exit code."""
    listen = _listening(scenario, options, status)
    security = scenario.security
    refuse_plain("netem", "--listen", security, listen)
    lease = lease_ms(scenario.peer_timeout_s)
    zenoh_options = replace(options.zenoh, credentials=credentials(security, "netem"), lease_ms=lease)
    traces = load_traces(scenario.network)
    node = build_netem(scenario, traces)
    gates, zenoh_options = gates_for(scenario.network, lease_s(zenoh_options), zenoh_options)
    interrupt = Interrupt()
    with ExitStack() as stack:
        stack.enter_context(interrupt.installed())
        deadline = Deadline(lambda text: status.failed(PeerError.exit_code, [text]))
        stack.enter_context(deadline.installed())
        endpoints: dict[Network, str] = dict(zip(("west", "east"), listen, strict=True))
        audit = AuditTrail.opened(stack, endpoints.items(), status.warning)
        sessions = _open_routers(stack, scenario, zenoh_options, endpoints, status.warning)
        earlier = earlier_part(options, scenario, "netem")
        log = stack.enter_context(open_log(options, scenario, "netem", earlier))
        for name, content in trace_attachments(scenario.network).items():
            log.attach(name, content)
        bridge = Bridge(sessions, {link.direction: link for link in node.links.values()}, gates)
        bridge.local = node.local
        stack.callback(bridge.close)
        meeting = new_meeting(scenario, "netem", ("west", "east"), interrupt, bridge.wake)
        for network, session in sessions.items():
            meeting.rosters[network].watch(session)
        meeting.exchange = stack.enter_context(ScenarioExchange(sessions, meeting.keys, "netem", scenario))
        _serve(stack, bridge, sessions, meeting, audit, status)
        applications = _applications(stack, bridge, sessions, lease_s(options.zenoh), status, audit)
        bridge.base_overhead_ns = warn_of_overhead(
            sessions, endpoints, ZenohOptions(credentials=zenoh_options.credentials), scenario.network, traces, status
        )
        token = meeting.keys.token("netem", meeting.digest, mirrored=False)
        _tokens = [session.liveliness().declare_token(token) for session in sessions.values()]
        status.ready()
        try:
            mirrors = _gather(meeting, sessions, options, status)
            if mirrors is None:
                return EXIT_INTERRUPTED
            applications.refuse_leaks()
            bridge.settle()
            looks = watches(bridge.links, scenario.network.buffer, status.warning)
            membership = _join(meeting)
            continued(log, options, scenario, "netem", earlier, membership.epoch.run_id)
            audit.begin(log.path.parent, membership.clock)
            _tokens += _begin(bridge, membership, sessions, meeting.keys)
            status.running(scenario.duration_s, str(log.path), membership.joined_ns)
            end = scenario.peer_loss_policy(options.alone) == "end"
            peers = _watch_peers(stack, sessions, meeting, membership, endpoints)
            watched = WatchedLog(log, *looks, audit=audit)
            deadline.progress = lambda: watched.n_records
            stack.callback(deadline.begin)
            return drive(bridge, {}, watched, meeting, membership, status, peers, end)
        except PeerError as error:
            _announce_end(sessions, meeting.keys, _reason(error.faults[0]))
            raise


def _applications(
    stack: ExitStack, bridge: Bridge, sessions: Sessions, lease_s: float, status: Status, audit: AuditTrail
) -> Applications:
    """Return what makes other programs' traffic cross, at work until ``stack`` closes."""
    keys = crossing_keys(["**"])
    applications = Applications(
        bridge, sessions, keys, lease_s, status.warning, gossip=audit.gossip, on_bypass=status.bypass
    )
    stack.callback(applications.close)
    applications.open()
    return applications


def _listening(scenario: Scenario, options: SideOptions, status: Status) -> tuple[str, ...]:
    """Return the endpoints to listen on, west, then east; warn of a certificate's end. Raises `InputError`."""
    for text in expiry_warnings(scenario.security, "netem"):
        status.warning(text)
    listen = tuple(options.zenoh.listen) or (
        *endpoints_for(scenario, "netem", "west"),
        *endpoints_for(scenario, "netem", "east"),
    )
    if len(listen) != 2:
        raise InputError(Fault("netem", "--listen", "must be given twice, west first, then east", list(listen)))
    return listen


def _open_routers(
    stack: ExitStack, scenario: Scenario, options: ZenohOptions, endpoints: Mapping[Network, str],
    tell: Callable[[str], None],
) -> dict[Network, zenoh.Session]:  # fmt: skip
    """Open netem's router on each network, with the access control of the run."""
    share_arenas()
    sessions: dict[Network, zenoh.Session] = {}
    security, renewed = scenario.security, None
    if isinstance(security, Mtls):
        renewed = RenewedListeners(Path(security.folder) / "netem", endpoints.values(), tell)
    for network, endpoint in endpoints.items():
        config = configure("router", replace(options, listen=[endpoint]))
        config.insert_json5("transport/link/rx/max_message_size", str(_MAX_MESSAGE_BYTES))
        if len(spares := with_spares(endpoint)) > 1:
            config.insert_json5("listen/endpoints", json.dumps(spares))
            config.insert_json5("listen/timeout_ms", str(_LISTEN_MS))
        devices = scenario.source.device_keys if network == "west" else ()
        releasers = scenario.patient.safety.releasers
        rights = access_control(security, scenario.session, network, devices, releasers)
        config.insert_json5("access_control", json.dumps(rights))
        sessions[network] = stack.enter_context(closing(open_router(config, endpoint), config))
        if renewed is not None:
            stack.callback(renewed.close)
    return sessions


def _serve(
    stack: ExitStack, bridge: Bridge, sessions: Sessions, meeting: Meeting, audit: AuditTrail, status: Status
) -> None:
    """Answer questions for the clock and requests to the emulator, pass emergency stops on, and note who connects."""
    keys = meeting.keys
    audit.watch(stack, sessions)
    security = meeting.scenario.security
    if isinstance(security, Mtls):
        Revocations([Path(security.folder)], audit, status.warning).watch(stack, sessions)
    stack.enter_context(ClockServer(sessions.values(), keys.clock))
    adapt = None if bridge.gates else without_gates
    stack.callback(attach(bridge, sessions, keys.session, adapt=adapt, audit=audit, sight=meeting.scenario.sight))
    emergency = EmergencyLine(sessions, keys.session, audit, security)
    stack.callback(emergency.close)
    bridge.also_counts.extend((audit.refusals.counters, emergency.counters))


def _join(meeting: Meeting) -> Membership:
    """Return a new run, or the one that the sides are in already: netem was started anew. Raises `PeerError`.

    A side is believed on its own network only.
    """
    told = {side: meeting.rosters[home].epochs.get(side) for home, side in SIDE_ON.items()}
    under_way = sorted({epoch for epoch in told.values() if epoch is not None})
    if not under_way:
        clock = WallClock(monotonic_ns() + _LEAD_NS)
        return Membership(Epoch(clock.epoch_ns, secrets.randbits(32), boot_digest()), clock)
    epoch = under_way[0]
    if len(under_way) > 1:
        raise PeerError(Fault("netem", "", "surgeon and patient are in different runs: start one of them anew"))
    if epoch.boot != boot_digest():
        rule = "cannot go on with the run of the sides: it began on another host, or before a restart of this one"
        raise PeerError(Fault("netem", "", rule))
    clock = WallClock(epoch.epoch_ns)
    joined_ns = clock.now_ns()
    if not 0 <= joined_ns < meeting.scenario.end_ns:
        raise PeerError(Fault("netem", "", "the run of the sides is over: start them anew"))
    return Membership(epoch, clock, joined_ns)


def _begin(bridge: Bridge, membership: Membership, sessions: Sessions, keys: ControlKeys) -> list[Any]:
    """Let the run's messages pass, and announce the run; return the tokens that do so."""
    for link in bridge.links.values():
        link.run_id = membership.epoch.run_id
    bridge.start(membership.clock)
    token = keys.run("netem", membership.epoch.text)
    return [session.liveliness().declare_token(token) for session in sessions.values()]


def _watch_peers(
    stack: ExitStack, sessions: Sessions, meeting: Meeting, membership: Membership, endpoints: Mapping[Network, str]
) -> PeerWatch:
    """Return the judge of the other sides' lives; it also passes their signs of life on."""
    beats = Beats("netem", sessions, meeting.keys, membership.epoch.run_id)
    stack.callback(beats.close)
    ports = {SIDE_ON[network]: {*filter(None, [port_of(one)])} for network, one in endpoints.items()}
    return PeerWatch("netem", beats, membership.clock, ports, meeting.present, meeting.scenario.peer_timeout_s)


def _gather(meeting: Meeting, sessions: Sessions, options: SideOptions, status: Status) -> list[Any] | None:
    """Wait for surgeon and patient, each on its network, and mirror their presence on the other network."""
    mirrors: dict[Side, Any] = {}
    until_s = None if options.wait_s is None else time.monotonic() + options.wait_s
    digest = meeting.digest
    while True:
        meeting.check_scenarios()
        for home, side in SIDE_ON.items():
            here = Presence(side, digest, mirrored=False) in meeting.rosters[home].present
            away: Network = "east" if home == "west" else "west"
            if Presence(side, digest, mirrored=False) in meeting.rosters[away].present:
                raise PeerError(Fault(side, "zenoh", f"is visible on the {away} network: it would bypass netem"))
            if here and side not in mirrors:
                token = meeting.keys.token(side, digest, mirrored=True)
                mirrors[side] = sessions[away].liveliness().declare_token(token)
            elif not here and side in mirrors:
                mirrors.pop(side).undeclare()
                if not options.alone:
                    raise PeerError(Fault("netem", "", f"{side} left before the run began"))
        missing = sorted(set(SIDE_ON.values()) - set(mirrors))
        if not missing:
            return list(mirrors.values())
        status.waiting(" and ".join(f"the {side}" for side in missing))
        if meeting.interrupt.requested:
            return None
        if until_s is not None and time.monotonic() > until_s:
            raise PeerError(Fault("netem", "barrier", f"{' and '.join(missing)} not there within {options.wait_s} s"))
        meeting.bell.wait(_GLANCE_S)


def _reason(fault: Fault) -> str:
    """Return why netem ends the run, with the side that is the reason."""
    return fault.rule if fault.where == "netem" else str(fault)


def _announce_end(sessions: Sessions, keys: ControlKeys, reason: str) -> None:
    for session in sessions.values():
        session.put(keys.end, json.dumps({"side": "netem", "reason": reason}), congestion_control=_WAIT)


command = netem_command(run_netem)

if __name__ == "__main__":
    run_to_end(lambda: typer.run(command))
