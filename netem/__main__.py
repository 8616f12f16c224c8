"""The emulator's process: ``python -m netem SCENARIO`` or ``tis netem SCENARIO``."""

import json
import secrets
import time
from collections.abc import Mapping
from contextlib import ExitStack
from dataclasses import replace
from typing import Any, Final

import typer
import zenoh

from common import scenario_io
from common.channels import Network, Side
from common.errors import EXIT_INTERRUPTED, Fault, InputError, PeerError
from common.runtime.clock import WallClock
from common.runtime.control import ControlKeys, Presence, answer_clock
from common.runtime.side import Interrupt, Meeting, Prepared, SideOptions, drive, new_meeting, open_log, settle
from common.runtime.side_cli import endpoints_for, side_command
from common.runtime.status import Status
from common.runtime.zenoh_bus import ZenohBus
from common.runtime.zenoh_session import configure, open_router
from common.scenario import Scenario
from common.units import NS_PER_MS
from netem.build import build_netem

_HOME: Final[dict[Side, Network]] = {"surgeon": "west", "patient": "east"}
_LEAD_NS: Final = 150 * NS_PER_MS
_GLANCE_S: Final = 0.5
_PROBE_S: Final = 0.05

Sessions = Mapping[Network, zenoh.Session]


def run_netem(scenario: Scenario, options: SideOptions, status: Status) -> int:
    """Stand between the two networks until the run is over; return the exit code."""
    listen = tuple(options.zenoh.listen) or (
        *endpoints_for(scenario, "netem", "west"),
        *endpoints_for(scenario, "netem", "east"),
    )
    if len(listen) != 2:
        raise InputError(Fault("netem", "--listen", "must be given twice, west first, then east", list(listen)))
    prepared = Prepared(build_netem(scenario))
    interrupt = Interrupt()
    with ExitStack() as stack:
        stack.enter_context(interrupt.installed())
        sessions: dict[Network, zenoh.Session] = {}
        for network, endpoint in zip(("west", "east"), listen, strict=True):
            config = configure("router", replace(options.zenoh, listen=[endpoint]))
            sessions[network] = stack.enter_context(open_router(config, endpoint))  # type: ignore[index]
        log = stack.enter_context(open_log(options, scenario, "netem"))
        meeting = new_meeting(scenario, "netem", ("west", "east"), interrupt)
        held: list[Any] = []
        for network, session in sessions.items():
            meeting.rosters[network].watch(session)
            held.append(answer_clock(session, meeting.keys))
        bus = ZenohBus(sessions, WallClock(0), meeting.inbox, forwards=True)
        bus.listen(prepared.node)
        token = meeting.keys.token("netem", scenario_io.digest(scenario), mirrored=False)
        held += [session.liveliness().declare_token(token) for session in sessions.values()]
        status.ready()
        try:
            mirrors = _gather(meeting, sessions, options, status)
            if mirrors is None:
                return EXIT_INTERRUPTED
            refuse_bypass(sessions, meeting.keys)
            settle()
            clock = WallClock(time.monotonic_ns() + _LEAD_NS)
            bus.clock = clock
            meeting.inbox.start(clock)
            for session in sessions.values():
                session.put(meeting.keys.epoch, json.dumps({"epoch_ns": clock.epoch_ns}))
            status.running(scenario.duration_s, str(options.run_dir / "netem.mcap"))
            end = scenario.peer_loss_policy(options.alone) == "end"
            return drive(prepared, log, bus, meeting, clock, status, end)
        except PeerError as error:
            _announce_end(sessions, meeting.keys, error.faults[0].rule)
            raise


def _gather(meeting: Meeting, sessions: Sessions, options: SideOptions, status: Status) -> list[Any] | None:
    """Wait for surgeon and patient, each on its network, and mirror their presence to the other one."""
    mirrors: dict[Side, Any] = {}
    until_s = None if options.wait_s is None else time.monotonic() + options.wait_s
    digest = scenario_io.digest(meeting.scenario)
    while True:
        meeting.check_scenarios()
        for side, home in _HOME.items():
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
        missing = sorted(set(_HOME) - set(mirrors))
        if not missing:
            return list(mirrors.values())
        status.waiting(" and ".join(f"the {side}" for side in missing))
        if meeting.interrupt.requested:
            return None
        if until_s is not None and time.monotonic() > until_s:
            raise PeerError(Fault("netem", "barrier", f"{' and '.join(missing)} not there within {options.wait_s} s"))
        meeting.bell.wait(_GLANCE_S)


def refuse_bypass(sessions: Sessions, keys: ControlKeys) -> None:
    """Raise `PeerError` when a message put on one network turns up on the other without netem's forwarding it.

    Control keys are never forwarded, so what arrives came another way.
    """
    probe = f"{keys.session}/@tis/probe/{secrets.token_hex(8)}"
    leaks: list[str] = []
    for origin, other in (("west", "east"), ("east", "west")):
        with sessions[other].declare_subscriber(probe, lambda _, o=origin: leaks.append(o)):  # type: ignore[index,misc]
            for _ in range(3):
                sessions[origin].put(probe, b"")  # type: ignore[index]
                time.sleep(_PROBE_S / 3)
    if leaks:
        raise PeerError(Fault("netem", "zenoh", f"messages from {leaks[0]} reach the other network past netem"))


def _announce_end(sessions: Sessions, keys: ControlKeys, reason: str) -> None:
    for session in sessions.values():
        session.put(keys.end, json.dumps({"side": "netem", "reason": reason}))


command = side_command("netem", run_netem)

if __name__ == "__main__":
    typer.run(command)
