"""Replay of a run's recorded arrivals through the patient: the live run's estimates and set points, bit for bit."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any, Final, NamedTuple

from msgspec import DecodeError
from pydantic_core import from_json

from tis.common.channels import direction_of, is_set_point
from tis.common.errors import DataError, Fault
from tis.common.header import Header
from tis.common.messages import Pose, Quaternion, Vector3, as_row, decode, encode
from tis.common.node import Arrival, Emission, Record
from tis.common.records import COUNTERS, ESTIMATES, ORIENTATIONS, PROMPT, TICKS, UNRECORDED
from tis.common.runtime.arm_memory import RESUMED_FILE, parse_resumed
from tis.common.runtime.log_parts import part_clock
from tis.common.runtime.loop import Delivery, Seat, run
from tis.common.runtime.user_code import USER_CODE_FILE, Origin, parse_origins
from tis.common.safety_records import QUARANTINE, STOPS, QuarantineNote, StopNote
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.log_paths import log_file, log_files
from tis.deploy.logs.payloads import other_version
from tis.deploy.logs.read.load import load_parts, load_side
from tis.deploy.logs.read.side_log import SideLog
from tis.deploy.shell import run_dir as folder
from tis.patient_side.build import build_patient, choose_models
from tis.patient_side.models import factories, origins, own_estimators, read_models
from tis.patient_side.node import PatientNode

_Address = tuple[str, str, bool, int]
_NOBODYS_RAD: Final = 1.234567890123e-9
"""A gripper's angle that no message states: whatever it is in differs from the message that came."""
_TURNS: Final = ("orientation", "gripper_rad", "gripper_std_rad")


@dataclass
class RecordedClock:
    """Clock that wakes each tick when the recorded one began; a tick missed in the run is missed again."""

    begun: list[tuple[int, int]]
    """(due_ns, begin_ns) of the ticks that happened, in order."""
    now: int = 0

    def now_ns(self) -> int:
        """Return the run time."""
        return self.now

    def pass_to(self, deadline_ns: int) -> None:
        """Move to when the loop woke for ``deadline_ns``: the beginning of the first tick due then or later."""
        at = bisect_left(self.begun, (deadline_ns, -1))
        begin_ns = self.begun[at][1] if at < len(self.begun) else deadline_ns
        self.now = max(deadline_ns, begin_ns)


class RecordedStop(NamedTuple):
    """A recorded request that was carried out: whether the arms were stopped after it."""

    recv_ns: int
    is_stopped: bool


@dataclass
class RecordedBus:
    """Bus that delivers the recorded arrivals by their effective stamps and drops sent messages.

    ``stop`` stops or releases the arms where a recorded request did: which requests the patient carried out is read
    from the log, as it holds no secrets, by which a patient would decide again.
    """

    arrivals: deque[Arrival | RecordedStop]
    clock: RecordedClock
    stop: Callable[[bool], None]

    def send(self, seat: int, emission: Emission) -> int:  # noqa: ARG002
        """Drop the message."""
        return self.clock.now_ns()

    def wait(self, deadline_ns: int) -> Delivery | None:
        """Return the next arrival stamped at or before the deadline."""
        while self.arrivals and self.arrivals[0].recv_ns <= deadline_ns:
            arrival = self.arrivals.popleft()
            if isinstance(arrival, Arrival):
                return Delivery(0, arrival)
            self.stop(arrival.is_stopped)
        self.clock.pass_to(deadline_ns)
        return None


@dataclass
class Estimates:
    """Recorder that keeps the estimates of a replay, at ticks and at arrivals, and the set points."""

    rows: dict[_Address, Any] = field(default_factory=dict)

    def record(self, record: Record) -> None:
        """Keep an estimate or a set point."""
        if is_set_point(record.topic) or _is_estimate(record.topic):
            row = from_json(record.data) if isinstance(record.data, bytes) else as_row(record.data)
            self.rows[_address(row)] = _value(row)


_ROUNDING: Final = 1e-12
"""Difference in m or rad that is no other result."""


@dataclass(frozen=True)
class Comparison:
    """Comparison of a replay's estimates with the recorded ones."""

    n_compared: int
    n_different: int
    n_absent: int
    damage: str | None = None
    changed: tuple[str, ...] = ()
    """Changes since the run in the code of user-defined estimators, one text each."""
    largest: float = inf
    """Largest difference between two numbers; infinite where anything else differs."""

    @property
    def identical(self) -> bool:
        """Tell whether every estimate is equal bit for bit."""
        return self.n_compared > 0 and self.n_different == 0 and self.n_absent == 0 and self.damage is None

    @property
    def is_rounding(self) -> bool:
        """Tell whether all differences are of the size of rounding, as another version or processor rounds."""
        return self.n_different > 0 and self.largest <= _ROUNDING and self.n_absent == 0 and self.damage is None

    def __str__(self) -> str:
        """Return the counts and the verdict; gaps of a damaged log are no differences."""
        counts = (
            f"{self.n_compared} estimates and set points replayed, {self.n_different} differ, "
            f"{self.n_absent} are in one only"
        )
        if self.identical:
            return f"{counts}: identical, bit for bit"
        if self.is_rounding:
            return f"{counts}: equal but for rounding, by {self.largest:.1e} at most"
        if self.n_different or (self.n_absent and self.damage is None):
            return f"{counts}: not identical"
        if not self.n_compared:
            return f"{counts}: nothing to compare"
        return f"{counts}: the readable part is identical, bit for bit, but the log does not hold the whole run"


def replay(run_dir: Path) -> Comparison:
    """Replay the patient of a run folder with the model stored there; raises `DataError`.

    User-defined estimators are loaded in their present version; raises `InputError` for a missing one.
    """
    scenario = folder.read_scenario(run_dir)
    own = own_estimators(scenario)
    file = folder.model_file(run_dir)
    models = choose_models(scenario, read_models(file), file.name)
    paths = log_files(run_dir).get("patient", (log_file(run_dir, "patient"),))
    log, replayed = load_parts(paths, "patient"), Estimates()
    if not any(not row["missed"] for row in log.of(TICKS)):
        raise DataError(Fault(str(paths[0]), "", "holds no ticks to replay"))
    # A patient that was started anew began without a memory, so each part is replayed by a patient of its own.
    for path in paths:
        _replay_part(path, scenario, build_patient(scenario, models, recording=None, own=factories(own)), replayed)
    return replace(_compare(log, replayed), changed=_changed(log, origins(own)))


def _replay_part(path: Path, scenario: Scenario, node: PatientNode, replayed: Estimates) -> None:
    """Drive a patient by the ticks and arrivals of one log, so that it sees the same as in the run."""
    log = load_side(path, "patient")
    begun = [(row["due_ns"], row["begin_ns"]) for row in log.of(TICKS) if not row["missed"]]
    if not begun:
        return
    part = part_clock(log.attachments)
    node.resume(parse_resumed(log.attachments.get(RESUMED_FILE, b"{}")))
    node.join(0, 0 if part is None else part.joined_ns or 0)
    clock = RecordedClock(begun)
    prompt_ns = [row["t_ns"] for row in log.of(PROMPT)]
    # no tick of a run is later, whatever a log states
    until_ns = min(max([*prompt_ns, *(due for due, _ in begun)]), scenario.end_ns + NS_PER_S) + 1
    bus = RecordedBus(_arrivals(path, scenario.session), clock, node.stop)
    run([Seat(node, replayed)], bus, clock, until_ns)


def _compare(log: SideLog, replayed: Estimates) -> Comparison:
    kept = {topic: rows for topic, rows in log.rows.items() if _is_estimate(topic) or is_set_point(topic)}
    recorded = {_address(row): _value(row) for rows in kept.values() for row in rows}
    found = replayed.rows
    if not any(map(is_set_point, kept)):  # a run of before there were set points
        found = {address: value for address, value in found.items() if address[0]}
    if not any(topic.startswith(f"{ORIENTATIONS}/") for topic in kept):  # a run of before orientations were estimated
        found = {address: value for address, value in found.items() if not address[0].startswith(ORIENTATIONS)}
    common = recorded.keys() & found.keys()
    different = [(recorded[address], found[address]) for address in common if recorded[address] != found[address]]
    largest = max((_difference(*pair) for pair in different), default=0.0)
    damage = log.coverage.problem
    if any(row["name"].startswith(f"{UNRECORDED}.") for row in log.of(COUNTERS)):
        damage = damage or "lacks records that were written too slowly"
    n_absent = len(recorded.keys() ^ found.keys())
    return Comparison(len(common), len(different), n_absent, damage, largest=largest)


def _difference(one: Any, other: Any) -> float:
    """Return the largest difference between the numbers of two records; infinite where anything else differs."""
    if isinstance(one, float) and isinstance(other, float):
        return abs(one - other)
    if isinstance(one, dict) and isinstance(other, dict) and one.keys() == other.keys():
        return max((_difference(one[name], other[name]) for name in one), default=0.0)
    if isinstance(one, tuple) and isinstance(other, tuple) and len(one) == len(other):
        return max(map(_difference, one, other), default=0.0)
    return 0.0 if one == other else inf


def _changed(log: SideLog, own: Mapping[str, Origin]) -> tuple[str, ...]:
    """Return the changes in user-defined estimators since the run, by the origins attached to its log."""
    recorded = parse_origins(log.attachments.get(USER_CODE_FILE, b"{}"), "patient.mcap")
    return tuple(
        f"{name}: {text} since the run"
        for name, origin in own.items()
        if name in recorded
        for text in origin.changes(recorded[name])
    )


def _is_estimate(topic: str) -> bool:
    return topic.startswith((f"{ESTIMATES}/", f"{ORIENTATIONS}/")) or topic == PROMPT


def _address(row: dict[str, Any]) -> _Address:
    """Return estimator or method ("" of a set point), hand, and the tick or the instant of the answered arrival."""
    at_tick = "tick" in row
    method = f"{ORIENTATIONS}/{row['method']}" if "method" in row else ""
    return (row.get("estimator", method), row["hand"], at_tick, row["tick"] if at_tick else row["t_ns"])


def _value(row: dict[str, Any]) -> tuple[Any, ...]:
    """Return the compared values: instant, position or orientation, and deviations or the safety state."""
    if "method" in row:
        return (row["t_ns"], row["std_rad"], *(row[name] for name in _TURNS))
    if "mode" in row:
        return (row["sample_ns"], row["position_m"], row["mode"])
    return (row["t_ns"], row["position_m"], row["std_m"])


def _contradiction(payload: bytes) -> Iterator[Arrival]:
    """Yield a message that contradicts the replayed ones as the quarantined one did, whose payload was not logged.

    Other messages in quarantine have changed nothing.
    """
    try:
        note = decode(payload, QuarantineNote)
    except DecodeError:
        raise other_version(QUARANTINE) from None
    if note.kind != "conflicting":
        return
    level = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    place = Vector3(x=note.x_m, y=note.y_m, z=note.z_m)
    pose = Pose(sample_ns=note.sample_ns, position_m=place, orientation=level, gripper_rad=_NOBODYS_RAD)
    yield Arrival("east", note.key, encode(pose), Header(note.seq).pack(), note.recv_ns)


def _arrivals(path: Path, session: str) -> deque[Arrival | RecordedStop]:
    """Return the arrivals in the order in which they came from the bus."""
    file, found = LogFile(path), deque[Arrival | RecordedStop]()
    for block in file.blocks():
        columns = (block.channel, block.seq, block.publish_ns, block.log_ns)
        payloads = block.payloads(slice(None))
        for channel, seq, sent_ns, log_ns, payload in zip(*(c.tolist() for c in columns), payloads, strict=True):
            key = file.topic(channel)
            if key == STOPS:
                try:
                    note = decode(payload, StopNote)
                except DecodeError:
                    raise other_version(STOPS) from None
                if not note.refused:
                    found.append(RecordedStop(log_ns, note.leaves_stopped))
            elif key == QUARANTINE:
                found.extend(_contradiction(payload))
            elif direction_of(key, session) == "forward":
                found.append(Arrival("east", key, payload, Header(seq, sent_ns).pack(), log_ns))
    return found
