"""Replay of a run's recorded arrivals through the patient: the live run's estimates and set points, bit for bit."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import inf
from pathlib import Path
from typing import Any, Final

from pydantic_core import from_json

from tis.common.channels import is_set_point
from tis.common.errors import DataError, Fault
from tis.common.messages import Message, Pose, SampledPose, ShownForce, Twist, Wrench, as_row
from tis.common.node import Record
from tis.common.records import COUNTERS, ESTIMATES, ORIENTATIONS, PROMPT, TICKS, UNRECORDED
from tis.common.runtime.arm_memory import RESUMED_FILE, parse_resumed
from tis.common.runtime.log_parts import part_clock
from tis.common.runtime.loop import Seat, run
from tis.common.runtime.recordings import load_recording
from tis.common.runtime.user_code import USER_CODE_FILE, Origin, parse_origins
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.log_paths import log_file, log_files
from tis.deploy.logs.read.load import load_parts, load_side
from tis.deploy.logs.read.side_log import SideLog
from tis.deploy.run.recorded import RecordedBus, RecordedClock, recorded_arrivals
from tis.deploy.run.replay_sight import replay_screen
from tis.deploy.shell import run_dir as folder
from tis.patient_side.build import build_patient, choose_models
from tis.patient_side.models import factories, origins, own_estimators, read_models
from tis.patient_side.node import PatientNode
from tis.surgeon_side.build import build_surgeon

# Replay of touch: the surgeon's hands from the logged forces, and what both sides sent, byte by byte.

_Sent = dict[tuple[str, int], bytes]
_BY_SURGEON: tuple[type[Message], ...] = (Twist, ShownForce, SampledPose, Pose)


@dataclass
class Forces:
    """Recorder that keeps what a side sends for touch, by key and number; by default the patient's forces."""

    models: tuple[type[Message], ...] = (Wrench,)
    sent: _Sent = field(default_factory=dict)
    unfinished: set[int] = field(default_factory=set)
    """Ticks in which the side was killed: its log has some of what it did then, and not that the tick ended."""

    def killed_after(self, ticks: Sequence[Mapping[str, Any]]) -> None:
        """Note the ticks of a part of the log that another part continues."""
        if ticks:
            self.unfinished.add(ticks[-1]["tick"] + 1)

    def record(self, record: Record) -> None:
        """Keep a message of a coupled stream."""
        if record.schema in self.models and isinstance(record.data, bytes):
            self.sent[record.topic, record.seq] = record.data


def replay_surgeon(paths: Sequence[Path], scenario: Scenario) -> Forces:
    """Return what a surgeon sends that feels the recorded forces, part by part; raises `InputError`, `DataError`."""
    recording, found = load_recording(scenario), Forces(_BY_SURGEON)
    for path in paths:
        log = load_side(path, "surgeon")
        begun = [(row["due_ns"], row["begin_ns"]) for row in log.of(TICKS) if not row["missed"]]
        if not begun:
            continue
        node, part = build_surgeon(scenario, recording), part_clock(log.attachments)
        node.join(0, 0 if part is None else part.joined_ns or 0)
        clock = RecordedClock(begun)
        bus = RecordedBus(recorded_arrivals(path, scenario.session, "feedback"), clock, lambda _: None)
        last_ns = max(due_ns for due_ns, _ in begun)
        if path != paths[-1]:
            found.killed_after(log.of(TICKS))
        run([Seat(node, found)], bus, clock, min(last_ns, scenario.end_ns + NS_PER_S) + 1)
    return found


def compare_forces(pairs: Iterable[tuple[Sequence[Path], Forces]]) -> tuple[int, int, int]:
    """Return the numbers of messages compared with those of the logs, of different ones, and of those in one only."""
    n_compared = n_different = n_absent = 0
    for paths, replayed in pairs:
        keys = {key for key, _ in replayed.sent}
        logged: _Sent = {}
        for path in paths:
            file = LogFile(path)
            for block in file.blocks():
                rows = zip(block.channel.tolist(), block.seq.tolist(), block.payloads(slice(None)), strict=True)
                logged |= {(key, seq): bytes(data) for at, seq, data in rows if (key := file.topic(at)) in keys}
        both = logged.keys() & replayed.sent.keys()
        n_compared += len(both)
        n_different += sum(logged[address] != replayed.sent[address] for address in both)
        n_absent += sum(seq not in replayed.unfinished for _, seq in logged.keys() ^ replayed.sent.keys())
    return n_compared, n_different, n_absent


_Address = tuple[str, str, bool, int]
_TURNS: Final = ("orientation", "gripper_rad", "gripper_std_rad")


@dataclass
class Estimates:
    """Recorder that keeps the estimates of a replay, at ticks and at arrivals, the set points, and the forces."""

    rows: dict[_Address, Any] = field(default_factory=dict)
    forces: Forces = field(default_factory=Forces)

    def record(self, record: Record) -> None:
        """Keep an estimate, a set point or a force."""
        self.forces.record(record)
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
        part = load_side(path, "patient")
        _replay_part(
            path, part, scenario, build_patient(scenario, models, recording=None, own=factories(own)), replayed
        )
        if path != paths[-1]:
            replayed.forces.killed_after(part.of(TICKS))
    found = replace(_compare(log, replayed), changed=_changed(log, origins(own)))
    if scenario.sight is not None:
        found = _with(found, replay_screen(run_dir, scenario))
    if scenario.touch is None:
        return found
    # nothing tells again what an external arm felt, or what a device did
    pairs = [] if scenario.patient.plant.kind == "external" else [(paths, replayed.forces)]
    if scenario.source.kind != "live":
        surgeons = log_files(run_dir).get("surgeon", (log_file(run_dir, "surgeon"),))
        pairs.append((surgeons, replay_surgeon(surgeons, scenario)))
    return _with(found, compare_forces(pairs))


def _with(found: Comparison, counts: tuple[int, int, int]) -> Comparison:
    """Return a comparison with the numbers of further records compared, of different ones, of those in one only."""
    n_compared, n_different, n_absent = counts
    largest = inf if n_different else found.largest
    return replace(
        found, n_compared=found.n_compared + n_compared, n_different=found.n_different + n_different,
        n_absent=found.n_absent + n_absent, largest=largest,
    )  # fmt: skip


def _replay_part(path: Path, log: SideLog, scenario: Scenario, node: PatientNode, replayed: Estimates) -> None:
    """Drive a patient by the ticks and arrivals of one log, so that it sees the same as in the run."""
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
    bus = RecordedBus(recorded_arrivals(path, scenario.session, "forward"), clock, node.stop)
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
    unfinished = replayed.forces.unfinished
    absent = recorded.keys() ^ found.keys()
    n_absent = sum(not (at_tick and number in unfinished) for _, _, at_tick, number in absent)
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
