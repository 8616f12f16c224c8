"""Process of surgeon and patient: clients of netem's router on their network."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Literal

import zenoh

from tis.common.channels import Network, Side
from tis.common.errors import EXIT_INTERRUPTED, Fault, PeerError
from tis.common.runtime.arm_memory import MEMORY_FILE, RESUMED_FILE, ArmMemory, dump_resumed, remembered
from tis.common.runtime.clock import WallClock
from tis.common.runtime.clock_watch import ClockWatch
from tis.common.runtime.companion import Companion
from tis.common.runtime.connections import closing
from tis.common.runtime.control import Epoch, Presence
from tis.common.runtime.credentials import credentials, expiry_warnings, refuse_plain
from tis.common.runtime.log_parts import EarlierPart
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.meeting import Meeting, ScenarioExchange, new_meeting
from tis.common.runtime.memory import share_arenas
from tis.common.runtime.peer_watch import Beats, PeerWatch
from tis.common.runtime.process import Interrupt
from tis.common.runtime.scheduling import settle
from tis.common.runtime.side import Membership, NodeWork, Prepared, drive, part_clock_of
from tis.common.runtime.side_log import SideOptions, continued, earlier_part, open_log
from tis.common.runtime.signing import Agreement, identity
from tis.common.runtime.status import Status
from tis.common.runtime.tls_links import CertifiedLink, false_names
from tis.common.runtime.zenoh_bus import Inbox, ZenohBus
from tis.common.runtime.zenoh_log import CLIENT_LEVELS, ConnectionTrouble, ZenohLog
from tis.common.runtime.zenoh_session import bypasses, configure, lease_ms, open_client
from tis.common.scenario import Scenario
from tis.common.scenario.security import Mtls
from tis.common.signing import SIGNERS, Identity
from tis.common.zenoh_syntax import port_of

_POLL_S: Final = 0.5
_COARSE_CLOCK_NS: Final = 1_000_000


def run_client_side(
    side: Literal["surgeon", "patient"],
    network: Network,
    scenario: Scenario,
    options: SideOptions,
    prepare: Callable[[], Prepared],
    status: Status,
) -> int:
    """Run surgeon or patient to its end and return the exit code.

    Raises `InputError`, `DataError` and `PeerError`. Everything that the user can get wrong (data, log, options) is
    checked before waiting for peers.
    """
    share_arenas()
    interrupt = Interrupt()
    with interrupt.installed():
        # Everything that can fail without the network.
        refuse_plain(side, "--connect", scenario.security, tuple(options.zenoh.connect))
        proof, own = credentials(scenario.security, side), identity(scenario.security, side)
        lease = lease_ms(scenario.peer_timeout_s)
        config = configure("client", replace(options.zenoh, credentials=proof, lease_ms=lease))
        prepared = prepare()
        for text in (*prepared.warnings, *expiry_warnings(scenario.security, side)):
            status.warning(text)
        deadline = _Deadline(options.wait_s)
        where, trouble = ", ".join(options.zenoh.connect), ConnectionTrouble()
        zenoh_log = ZenohLog(CLIENT_LEVELS, trouble.take) if proof else contextlib.nullcontext()
        earlier = earlier_part(options, scenario, side)
        with zenoh_log, open_log(options, scenario, side, earlier) as log:
            session = open_client(
                config,
                lambda: interrupt.requested or deadline.over(),
                lambda: status.waiting(f"netem at {where}{trouble.text}"),
            )
            if session is None:
                text = f"netem at {where} did not answer within {options.wait_s} s{trouble.text}"
                return _gave_up(side, interrupt, text)
            with closing(session, config):
                faults = bypasses(session)
                names = false_names(session) if isinstance(scenario.security, Mtls) else []
                faults += [f"its certificate is of {one}, must be netem's" for one in names]
                if faults:
                    raise PeerError([Fault(side, "zenoh", fault) for fault in faults])
                inbox: Inbox[zenoh.Sample] = Inbox()
                meeting = new_meeting(scenario, side, [network], interrupt, inbox.alarm)
                exchange = ScenarioExchange({network: session}, meeting.keys, side, scenario)
                meeting.exchange = exchange
                connect = tuple(options.zenoh.connect)
                client = _Client(
                    side, network, session, meeting, inbox, deadline, status, options, connect, earlier, own
                )
                with exchange:
                    return client.meet_and_run(prepared, log)


@dataclass(frozen=True)
class _Client:
    """A connected side, from the barrier to the end."""

    side: Side
    network: Network
    session: zenoh.Session
    meeting: Meeting
    inbox: Inbox[zenoh.Sample]
    deadline: "_Deadline"
    status: Status
    options: SideOptions
    connect: tuple[str, ...]
    earlier: EarlierPart | None
    own: Identity | None

    def meet_and_run(self, prepared: Prepared, log: McapLog) -> int:
        meeting = self.meeting
        roster = meeting.rosters[self.network]
        roster.watch(self.session)
        # netem declares its token last, so it answers queries as soon as the token is present.
        if not self._wait_until(lambda: "netem" in roster.sides(), is_known=False):
            return self._gave_up()
        with contextlib.ExitStack() as stack:
            watch = stack.enter_context(contextlib.closing(ClockWatch(self.session, meeting.keys.clock)))
            companion, beside = None, prepared.beside
            if beside is not None:
                options, scenario = self.options.zenoh, meeting.scenario
                tell = self.status.warning
                companion = Companion(self.side, beside, scenario, options, meeting.bell.ring, tell)
                stack.enter_context(companion)
            return self._meet_and_run(prepared, log, watch, companion)

    def _meet_and_run(self, prepared: Prepared, log: McapLog, watch: ClockWatch, companion: Companion | None) -> int:
        watch.meet()
        reading = watch.reading()
        if reading.bound_ns > _COARSE_CLOCK_NS:
            self.status.warning(f"netem's clock is known to +- {reading.bound_ns / 1e6:.2f} ms only")
        bus = ZenohBus({self.network: self.session}, WallClock(0), self.inbox)
        bus.listen(prepared.node, prepared.foreign_keys)
        bus.announce(prepared.node)
        settle()
        if companion is not None and not self._wait_until(
            companion.check, lambda: f"the {companion.name}", is_known=False
        ):
            return self._gave_up()
        with contextlib.ExitStack() as stack:
            security = self.meeting.scenario.security
            if isinstance(security, Mtls):
                folder = Path(security.folder) / self.side
                stack.enter_context(CertifiedLink(self.session, folder, self.own, self.status.warning))
            if not self._agree(stack, prepared, bus, companion):
                return self._gave_up()
            return self._join_and_run(prepared, log, watch, bus, companion)

    def _agree(
        self, stack: contextlib.ExitStack, prepared: Prepared, bus: ZenohBus, companion: Companion | None
    ) -> bool:
        """Agree with the other side on the run's keys, where messages are signed; False when given up."""
        meeting = self.meeting
        if self.own is None or self.options.witness:
            return True
        prefix = meeting.scenario.session

        def changed() -> None:
            meeting.bell.ring()
            if companion is not None:
                companion.renew(agreement.keys)

        agreement = Agreement(self.session, prefix, self.side, meeting.digest, self.own, changed)  # type: ignore[arg-type]
        stack.enter_context(agreement)
        bus.keys = agreement.keys
        prepared.node.believe(agreement.keys, self.own)
        whom = f"the {SIGNERS[self.side]} to prove its name"
        return self._wait_until(lambda: agreement.is_reached, lambda: f"{whom}{agreement.fault}", is_known=False)

    def _join_and_run(
        self, prepared: Prepared, log: McapLog, watch: ClockWatch, bus: ZenohBus, companion: Companion | None
    ) -> int:
        meeting, scenario = self.meeting, self.meeting.scenario
        roster = meeting.rosters[self.network]
        # A side that was killed or cut off stays present until its connection ends.
        own = Presence(self.side, meeting.digest, mirrored=False)
        # As a witness another program is this side, and this one keeps silent.
        is_witness, to_leave = self.options.witness, f"another {self.side} to leave"
        if not is_witness and not self._wait_until(
            lambda: own not in roster.present, lambda: to_leave, is_known=False
        ):
            return self._gave_up()
        # The barrier: the token tells the others that this side is ready, netem then begins the run.
        is_under_way = roster.epoch is not None
        liveliness = self.session.liveliness()
        tokens = [] if is_witness else [liveliness.declare_token(meeting.keys.token(*own))]
        self.status.ready()
        if not self._wait_until(lambda: roster.epoch is not None):
            return self._gave_up()
        assert roster.epoch is not None
        membership = self._join(roster.epoch, watch, log, is_under_way)
        clock, bus.run_id = membership.clock, membership.epoch.run_id
        bus.clock = clock
        if companion is not None:
            companion.begin(part_clock_of(membership, scenario), log.path, bus.keys)
        memory, attachments = _resume(prepared, log.path.with_name(MEMORY_FILE), membership)
        prepared.node.join(bus.run_id, membership.joined_ns or 0)
        self.inbox.start(clock)
        if not is_witness:
            tokens.append(liveliness.declare_token(meeting.keys.run(self.side, membership.epoch.text)))
        self.status.running(scenario.duration_s, str(log.path), membership.joined_ns)
        end = scenario.peer_loss_policy(self.options.alone) == "end"
        beats = Beats(self.side, {self.network: self.session}, meeting.keys, bus.run_id, is_witness, bus.keys)
        ports: dict[Side, set[int]] = {"netem": {*filter(None, map(port_of, self.connect))}}
        peers = PeerWatch(self.side, beats, clock, ports, meeting.present, scenario.peer_timeout_s)
        try:
            with memory:
                work = NodeWork(prepared.node, bus, self.inbox, clock, watch, membership.epoch.epoch_ns, memory)
                code = drive(work, attachments, log, meeting, membership, self.status, peers, end)
                memory.forget()
                return code
        finally:
            beats.close()
            for token in tokens:
                token.undeclare()  # type: ignore[no-untyped-call]

    def _join(self, epoch: Epoch, watch: ClockWatch, log: McapLog, is_under_way: bool) -> Membership:
        """Return this side's place in the run, from now on where it is under way; raises `PeerError`.

        The epoch is an instant of netem's clock; this side's clock is shifted by the present offset. A side that
        continues its log stays on the time base of the part before.
        """
        own_epoch_ns = epoch.epoch_ns - watch.reading().offset_ns
        earlier = continued(log, self.options, self.meeting.scenario, self.side, self.earlier, epoch.run_id)
        if earlier is not None:
            own_epoch_ns = earlier.clock.epoch_monotonic_ns
        clock = WallClock(own_epoch_ns)
        if not is_under_way:
            return Membership(epoch, clock)
        joined_ns = clock.now_ns()
        if joined_ns >= self.meeting.scenario.end_ns:
            raise PeerError(Fault(self.side, "", "the run of the others is over"))
        return Membership(epoch, clock, max(0, joined_ns))

    def _wait_until(
        self, met: Callable[[], bool], whom: Callable[[], str] | None = None, is_known: bool = True
    ) -> bool:
        """Wait and report for whom; False when interrupted or past the deadline. Raises `PeerError`.

        ``is_known``: the others have seen this side's token. Only then another scenario ends this side, for they must
        learn of it, too.
        """
        meeting, roster = self.meeting, self.meeting.rosters[self.network]
        while not met():
            if is_known:
                meeting.check_scenarios()
            if roster.end_reason is not None:
                raise PeerError(Fault(self.side, "", f"the run was ended before it began: {roster.end_reason}"))
            if "netem" in meeting.lost() and not self.options.alone:
                raise PeerError(Fault(self.side, "", "netem left before the run began"))
            missing = {"surgeon", "netem", "patient"} - roster.sides()
            missing -= set() if self.options.witness else {self.side}
            if whom is not None:
                self.status.waiting(whom())
            elif missing:
                names = ("netem" if name == "netem" else f"the {name}" for name in sorted(missing))
                self.status.waiting(" and ".join(names))
            if meeting.interrupt.requested or self.deadline.over():
                return False
            meeting.bell.wait(_POLL_S)
        return True

    def _gave_up(self) -> int:
        roster = self.meeting.rosters[self.network]
        missing = sorted({"surgeon", "netem", "patient"} - roster.sides() - {self.side})
        return _gave_up(self.side, self.meeting.interrupt, f"{' and '.join(missing) or 'netem'} did not come in time")


def _resume(prepared: Prepared, path: Path, membership: Membership) -> tuple[ArmMemory, dict[str, bytes]]:
    """Let a side that comes back go on after its earlier process; return what outlives this one, and attachments."""
    topics, attachments = prepared.node.remembers(), dict(prepared.attachments)
    last = {} if membership.joined_ns is None else remembered(path, topics)
    if last:
        prepared.node.resume(last)
        attachments[RESUMED_FILE] = dump_resumed(last)
    return ArmMemory(path, topics, last), attachments


class _Deadline:
    """Limit of the wait for the other sides; none when ``wait_s`` is None."""

    def __init__(self, wait_s: float | None) -> None:
        self._until_s = None if wait_s is None else time.monotonic() + wait_s

    def over(self) -> bool:
        return self._until_s is not None and time.monotonic() > self._until_s


def _gave_up(side: Side, interrupt: Interrupt, text: str) -> int:
    if interrupt.requested:
        return EXIT_INTERRUPTED
    raise PeerError(Fault(side, "barrier", text))
