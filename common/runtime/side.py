"""Life cycle of a side's process: prepare, meet the others, agree on an epoch, run, end cleanly."""

import os
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Protocol

import zenoh

from tis.common.errors import EXIT_INTERRUPTED, EXIT_OK, DataError, Fault, PeerError
from tis.common.host_records import DISCIPLINE
from tis.common.node import Record, SideNode
from tis.common.peer_life import Alarm
from tis.common.records import COUNTERS, CounterNote
from tis.common.runtime.arm_memory import ArmMemory
from tis.common.runtime.clock import Clock, WallClock
from tis.common.runtime.clock_watch import ClockWatch, read_discipline
from tis.common.runtime.companion import Beside
from tis.common.runtime.control import Epoch, boot_digest
from tis.common.runtime.log_parts import CLOCK_FILE, PartClock
from tis.common.runtime.loop import LateRecorder, Recorder, Seat, run
from tis.common.runtime.meeting import Meeting
from tis.common.runtime.peer_watch import BEAT_EVERY_S, PeerWatch, tell
from tis.common.runtime.processor_watch import ProcessorWatch
from tis.common.runtime.recorder import MAX_WAITING_BYTES, FileLog, ThreadedRecorder, TicksOnly, recorder_for
from tis.common.runtime.status import Status
from tis.common.runtime.zenoh_bus import Inbox, ZenohBus
from tis.common.scenario import Scenario

_LOOKS_PER_PROGRESS: Final = 3
_AnyRecorder = ThreadedRecorder | TicksOnly
_ENDING_NS: Final = 200_000_000
_DRIFT: Final = 500e-6  # of two clocks that were compared at the beginning, with a margin
_TOKENS_S: Final = 0.1  # within which the tokens of a dead netem arrive, one after the other


@dataclass(frozen=True)
class Prepared:
    """Preparations of a side before it meets the others: its node, files for its log, foreign keys, company."""

    node: SideNode
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    foreign_keys: Collection[str] = ()
    beside: Beside | None = None


@dataclass(frozen=True)
class Membership:
    """A side's place in a run: the run, the side's own clock, and the run time of a restarted side's return."""

    epoch: Epoch
    clock: WallClock
    joined_ns: int | None = None


class Work(Protocol):
    """The work of a side from the epoch to the end."""

    @property
    def error(self) -> BaseException | None:
        """Return the exception of a callback, if any; it ends the run."""

    def run(self, recorder: LateRecorder, until_ns: int, stopped: Callable[[], bool]) -> None:
        """Work and record until run time ``until_ns``, or until ``stopped``."""

    def turn(self, now_ns: int) -> tuple[int, str]:
        """Return the run time of the loop's last turn, now while it waits, and what it does."""

    def alarms(self) -> Mapping[Alarm, int]:
        """Return what the side has evidence of, by the run time at which it began."""

    def counters(self) -> dict[str, int]:
        """Return the present counters by name."""


@dataclass(frozen=True)
class NodeWork:
    """A node, driven by the loop, while its clock is compared with netem's."""

    node: SideNode
    bus: ZenohBus
    inbox: Inbox[zenoh.Sample]
    clock: WallClock
    watch: ClockWatch
    reference_epoch_ns: int
    memory: ArmMemory

    @property
    def error(self) -> BaseException | None:
        """Return the exception of a callback, if any."""
        return self.inbox.error

    def run(self, recorder: Recorder, until_ns: int, stopped: Callable[[], bool]) -> None:
        """Drive the node; the inbox was started when the epoch became known."""
        self.watch.follow(recorder, self.clock, self.reference_epoch_ns)
        run(
            [Seat(self.node, self.memory.around(recorder))],
            self.bus,
            self.clock,
            until_ns,
            lambda: bool(self.error) or stopped(),
        )
        self.watch.close()
        for name, value in (("before_epoch", self.inbox.n_early), ("flooded", self.inbox.n_flooded)):
            recorder.record(Record(COUNTERS, self.clock.now_ns(), CounterNote(name=name, value=value)))

    def turn(self, now_ns: int) -> tuple[int, str]:
        """Return since when the node computes, now while the loop waits, and what it does."""
        since_ns = self.bus.busy_since_ns
        return (now_ns, "") if since_ns is None else (since_ns, self.node.doing)

    def alarms(self) -> Mapping[Alarm, int]:
        """Return the node's alarms."""
        return self.node.alarms()

    def counters(self) -> dict[str, int]:
        """Return the node's counters."""
        return self.node.counters()


def drive(
    work: Work, attachments: Mapping[str, bytes], log: FileLog, meeting: Meeting, membership: Membership,
    status: Status, peers: PeerWatch, end: bool,
) -> int:  # fmt: skip
    """Run a side from the epoch to the end of the drain; return the exit code. Raises `PeerError`, `DataError`.

    ``end``: a lost peer ends the run. The log is closed in every case.
    """
    scenario, clock = meeting.scenario, membership.clock
    # What the log needs to explain itself is attached before the first record, and is on the disk at once.
    log.attach(CLOCK_FILE, part_clock_of(membership, scenario).model_dump_json().encode())
    for name, data in attachments.items():
        log.attach(name, data)
    log.flush()
    recorder = recorder_for(log, lambda error: status.warning(_log_lost(error, scenario, clock)))
    _note_discipline(recorder, clock)
    processors = ProcessorWatch(clock)
    n_lost_before, needs_log = len(meeting.lost()), scenario.on_log_loss == "end"

    def stopped() -> bool:
        lost = end and (len(meeting.lost()) > n_lost_before or bool(peers.lost))
        unwritable = needs_log and recorder.error is not None
        ended = meeting.interrupt.requested or meeting.end_reason() is not None
        return ended or lost or unwritable or bool(failures)

    finished, failures = threading.Event(), list[Exception]()

    def report() -> None:
        try:
            _report(finished, clock, work, status, recorder, scenario.end_ns, peers, end)
        except Exception as error:  # without beats the others would take this side for dead
            failures.append(error)

    reporter = threading.Thread(target=report, name="progress", daemon=True)
    reporter.start()
    try:
        work.run(recorder, scenario.end_ns, stopped)
    finally:
        finished.set()
        reporter.join()  # it records, too
        _note_discipline(recorder, clock)
        recorder.record(processors.record())
        recorder.close()
    # The log is closed; what remains is the cause of the end.
    _raise_failure(str(meeting.side), recorder, work.error, failures)
    if meeting.interrupt.requested:
        status.failed(
            EXIT_INTERRUPTED, [f"interrupted at {clock.now_ns() * 1e-9:.1f} s, the log is complete up to there"]
        )
        return EXIT_INTERRUPTED
    if clock.now_ns() < scenario.end_ns:
        time.sleep(_TOKENS_S)
        raise PeerError(_why_ended(meeting, peers))
    status.ended(work.counters())
    return EXIT_OK


def part_clock_of(membership: Membership, scenario: Scenario) -> PartClock:
    """Return the time base of a log."""
    return PartClock(
        epoch_monotonic_ns=membership.clock.epoch_ns,
        epoch_unix_ns=membership.clock.unix_epoch_ns(),
        real_time=int(os.sched_getscheduler(0) != os.SCHED_OTHER),
        run_id=membership.epoch.run_id,
        boot=boot_digest(),
        joined_ns=membership.joined_ns,
        counts_gap=scenario.on_rejoin == "count",
    )


def _raise_failure(
    side: str, recorder: _AnyRecorder, error: BaseException | None, failures: Sequence[Exception]
) -> None:
    """Raise what failed during the run, the most specific cause first."""
    if recorder.error is not None:
        raise DataError(Fault(side, "log", f"{recorder.error.strerror}, {recorder.n_dropped} records lost"))
    if error is not None:
        raise RuntimeError("a Zenoh callback failed") from error
    if failures:
        raise RuntimeError("the watch over the other sides failed") from failures[0]


def _log_lost(error: OSError, scenario: Scenario, clock: Clock) -> str:
    goes_on = "goes on without it" if scenario.on_log_loss == "continue" else "ends (on_log_loss)"
    return (
        f"the log cannot be written any more since {clock.now_ns() * 1e-9:.1f} s: {error.strerror}; the run {goes_on}"
    )


def _note_discipline(recorder: Recorder, clock: Clock) -> None:
    note = read_discipline(clock.now_ns())
    if note is not None:
        recorder.record(Record(DISCIPLINE, note.at_ns, note))


def _why_ended(meeting: Meeting, peers: PeerWatch) -> Fault:
    lost, reason = meeting.lost(), meeting.end_reason()
    if lost and (lost[0] == "netem" or reason is None):
        return Fault(meeting.side, "", f"{lost[0]} left during the run")
    if peers.last_loss is not None and reason is None:
        peer, text = peers.last_loss
        return Fault(meeting.side, "", f"{peer} {text}")
    return Fault(meeting.side, "", f"the run was ended: {reason}")


def _report(
    finished: threading.Event, clock: WallClock, work: Work, status: Status, recorder: _AnyRecorder, end_ns: int,
    peers: PeerWatch, end: bool,
) -> None:  # fmt: skip
    """Look after the other sides, and report the progress, until the run is over."""
    n_looks, slow = 0, _SlowLog(status)
    while not finished.wait(BEAT_EVERY_S):
        now_ns = clock.now_ns()
        recorder.keep_up()
        changes = peers.look(*work.turn(now_ns), work.alarms(), work.counters().get("ticks_missed"))
        if now_ns * (1 + _DRIFT) > end_ns - _ENDING_NS:  # at the end each leaves in its own time
            changes = [change for change in changes if change.peer == status.side]
        tell(changes, recorder, status, end)
        n_looks += 1
        if n_looks % _LOOKS_PER_PROGRESS == 0:
            backlog = {"log_waiting_kb": recorder.waiting_bytes >> 10}
            status.progress(now_ns * 1e-9, {**work.counters(), **backlog})
            slow.look(recorder)
    tell(peers.own_changes(), recorder, status, end)  # a step of the clock may itself be what ended the run


class _SlowLog:
    """Tells once that a log falls behind, and once that it lacks records."""

    def __init__(self, status: Status) -> None:
        self._status = status
        self._told: set[str] = set()

    def look(self, recorder: _AnyRecorder) -> None:
        if 4 * recorder.waiting_bytes > MAX_WAITING_BYTES:
            self._tell(f"the log falls behind: {recorder.waiting_bytes >> 20} MB wait to be written", "behind")
        if recorder.unrecorded:
            topics = ", ".join(sorted(recorder.unrecorded))
            self._tell(f"the log lacks records, the disk or this machine is too slow: {topics}", "lacks")

    def _tell(self, text: str, what: str) -> None:
        if what not in self._told:
            self._told.add(what)
            self._status.warning(text)
