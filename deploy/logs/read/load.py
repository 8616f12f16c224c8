"""Logs of a run folder, on one clock, and what they say of the run: mode, scenario, models, user code."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Final, NamedTuple, get_args

from tis.common.channels import Direction, Hand, Side, direction_of
from tis.common.errors import DataError, Fault, problem
from tis.common.records import COUNTERS
from tis.common.runtime.chunk_writer import by_channel
from tis.common.runtime.log_parts import PartClock, companion_logs, part_clock
from tis.common.runtime.memory import release_large_arrays, without_collector
from tis.common.runtime.user_code import USER_CODE_FILE, Origin, parse_origins
from tis.common.sight_records import PICTURES
from tis.common.sources.provenance import MODEL_FILES
from tis.common.units import NS_PER_MS
from tis.deploy.logs.blocks import MAX_NUMBER, Block
from tis.deploy.logs.coverage import FOREVER, Coverage, Span
from tis.deploy.logs.log_file import LogFile, truncated_start
from tis.deploy.logs.log_paths import log_files
from tis.deploy.logs.read.clocks import CLOCK_TOPICS, RunClocks, run_clocks
from tis.deploy.logs.read.frame import Frame
from tis.deploy.logs.read.side_log import SideLog
from tis.deploy.shell import run_dir as folder
from tis.patient_side.identification.model_file import parse_models
from tis.patient_side.statespace import ArmModel

_WRITTEN_BY: Final = "tis"
_NO_COUNTS: Final = ("_ns", "most_held")
_MAX_CLOCK_STEP_NS: Final = NS_PER_MS
"""By which the parts' estimates of the epoch on their host's clock may differ."""


@dataclass
class RunLogs:
    """The logs of a run by side; all stamps are on the reference clock, which is netem's."""

    run_dir: Path
    sides: dict[Side, SideLog] = field(default_factory=dict)
    clocks: RunClocks = field(default_factory=RunClocks)

    def of(self, side: Side, topic: str) -> Frame:
        """Return a side's records of a topic; empty when the log is missing."""
        return self.sides.get(side, SideLog(side)).of(topic)

    def of_hand(self, side: Side, topic: str, hand: Hand) -> Frame:
        """Return a side's records of a topic for one hand."""
        rows = self.of(side, topic)
        return rows.at(rows.where("hand", hand))

    def of_arm(self, side: Side, is_topic: Callable[[str], bool], hand: Hand) -> Frame | None:
        """Return a side's records for one hand on the topic of its arm that ``is_topic`` tells; None for none."""
        topics = self.sides.get(side, SideLog(side)).rows
        each = (self.of_hand(side, topic, hand) for topic in topics if is_topic(topic))
        return next((rows for rows in each if len(rows)), None)

    def attachments(self, side: Side) -> dict[str, bytes]:
        """Return the files attached to a side's log; empty when the log is missing."""
        log = self.sides.get(side)
        return {} if log is None else log.attachments

    def messages(self, side: Side, direction: Direction, session: str) -> dict[str, Frame]:
        """Return a side's messages that go in ``direction``, by key."""
        log = self.sides.get(side)
        known = {} if log is None else log.messages
        return {key: frame for key, frame in known.items() if direction_of(key, session) == direction}

    def problems(self) -> list[str]:
        """Return a sentence for each missing or damaged log."""
        cure = "copy it from its host (tis collect), then tis summarize"
        found = [problem(f"{side}: log is missing", cure) for side in get_args(Side) if side not in self.sides]
        found += [f"{side}: {text}" for side, log in self.sides.items() if (text := log.coverage.problem)]
        beside = [one for log in self.sides.values() for one in log.beside]
        return found + [f"{one.file}: {text}" for one in beside if (text := one.problem)]

    def coverage(self, side: Side) -> Coverage | None:
        """Return the coverage of a side's log; None when it is missing or void."""
        log = self.sides.get(side)
        return None if log is None or log.coverage.void else log.coverage

    @property
    def left_out(self) -> tuple[Span, ...]:
        """Return the spans without one of the sides that figures leave out."""
        return tuple(span for log in self.sides.values() for span in log.coverage.left_out)

    @property
    def all_covered(self) -> bool:
        """Tell whether each side has a log that is not void."""
        return all(self.coverage(side) is not None for side in get_args(Side))


def load_side(path: Path, side: Side, wanted: Collection[str] | None = None) -> SideLog:
    """Read one log: the side's own records by topic, and the messages that it sent and received by key.

    ``wanted`` selects topics; `last_ns` is of all. A damaged log is read as far as possible. Raises `DataError` when
    the file is no log of this version.
    """
    log = SideLog(side)
    part = _read_part(log, path, wanted)
    log.metadata, log.attachments, log.coverage = part.metadata, part.attachments, part.coverage
    return log


def load_parts(paths: Sequence[Path], side: Side, wanted: Collection[str] | None = None) -> SideLog:
    """Read the parts of one log as one, as `load_side` does; the counters of all parts add up.

    A part without any record is of a process that ended before it was in the run. Raises `DataError`, also when the
    parts are not of one run or not on one clock.
    """
    log, known = SideLog(side), list[_Part]()
    for path in paths:
        if not (torn := truncated_start(path)):
            known.append(_read_part(log, path, wanted))
        elif len(paths) == 1:
            return empty_log(side, path, torn)
    parts = [part for part in known if part.n_messages or part.clock is not None] or known
    if not parts:
        return empty_log(side, paths[0], truncated_start(paths[0]) or "")
    first = parts[0]
    log.metadata, log.coverage = first.metadata, first.coverage
    if first.clock is not None and first.clock.joined_ns is not None:  # what came before it is lost
        log.coverage = _continued(Coverage(first.coverage.file, unknown=((0, FOREVER),)), 0, first)
    for before, part in pairwise(parts):
        _check_continues(before, part)
        log.coverage = _continued(log.coverage, before.last_ns, part)
    for part in reversed(parts):
        log.attachments |= part.attachments
    if len(parts) > 1 and COUNTERS in log.rows:
        log.rows[COUNTERS] = _added_up(log.rows[COUNTERS])
    return log


class _Part(NamedTuple):
    """A part of a log, apart from its messages."""

    metadata: dict[str, str]
    attachments: dict[str, bytes]
    coverage: Coverage
    last_ns: int
    n_messages: int

    @property
    def clock(self) -> PartClock | None:
        return part_clock(self.attachments)


def _read_part(log: SideLog, path: Path, wanted: Collection[str] | None) -> _Part:
    """Read one file's messages into ``log``; return the rest."""
    file = LogFile(path)
    n_before, last_before_ns, log.last_ns = log.n_messages, log.last_ns, 0
    for block in file.blocks():
        check_written_by_tis(file)
        _check_instants(path, block)
        for channel_id, which in by_channel(block.channel):
            topic = file.topic(channel_id)
            if topic != PICTURES if wanted is None else topic in wanted:
                log.add_block(topic, block, which)
            else:
                log.last_ns = max(log.last_ns, int(block.log_ns[which].max()))
    check_written_by_tis(file)
    last_ns, log.last_ns = log.last_ns, max(log.last_ns, last_before_ns)
    attachments = {name: attachment.data for name, attachment in file.attachments.items()}
    metadata = file.metadata.get("run", {})
    return _Part(metadata, attachments, Coverage.of(file, last_ns), last_ns, log.n_messages - n_before)


def _add_companions(log: SideLog, run_dir: Path, wanted: Collection[str] | None) -> None:
    """Add the records of what ran beside a side, on its clock; raises `DataError` when they are of another run."""
    own = part_clock(log.attachments)
    for path in companion_logs(run_dir, log.side):
        if torn := truncated_start(path):
            log.beside += (empty_log(log.side, path, torn).coverage,)
            continue
        part = _read_part(log, path, wanted)
        log.beside += (part.coverage,)
        if own is not None and part.clock is not None and part.clock.run_id != own.run_id:
            raise DataError(Fault(path.name, "", "is of another run"))


def _check_continues(before: _Part, part: _Part) -> None:
    one, other = before.clock, part.clock
    why = None
    if one is None or other is None or other.joined_ns is None or other.run_id != one.run_id:
        why = "is of another run"
    elif abs(other.epoch_monotonic_ns - one.epoch_monotonic_ns) > _MAX_CLOCK_STEP_NS or other.boot != one.boot:
        why = "is on another clock"
    if why is not None:
        rule = f"does not continue {before.coverage.file}: it {why}"
        raise DataError(Fault(part.coverage.file, "", rule))


def _continued(coverage: Coverage, last_ns: int, part: _Part) -> Coverage:
    clock = part.clock
    assert clock is not None
    return coverage.continued(last_ns, part.coverage, clock.joined_ns or 0, clock.counts_gap)


def _added_up(rows: Frame) -> Frame:
    """Return the counters of all parts: sums, and the largest of what is no count."""
    total: dict[str, int] = {}
    for row in rows:
        name, value = row["name"], row["value"]
        known = total.get(name, 0)
        total[name] = max(known, value) if name.endswith(_NO_COUNTS) else known + value
    found = Frame.of(COUNTERS)
    found.extend([{"name": name, "value": value} for name, value in total.items()])
    return found


def _check_instants(path: Path, block: Block) -> None:
    for name, ns in (("log_time", block.log_ns), ("publish_time", block.publish_ns)):
        if len(ns) and (latest_ns := int(ns.max())) > MAX_NUMBER:
            raise DataError(Fault(str(path), name, f"must be at most {MAX_NUMBER} ns of run time", latest_ns))


def check_written_by_tis(file: LogFile) -> None:
    """Raise `DataError` when another program wrote the file."""
    if file.header is not None and file.header.library != _WRITTEN_BY:
        raise DataError(Fault(str(file.path), "", f"is no log of tis, but of {file.header.library!r}"))


def load_run(run_dir: Path, wanted: Collection[str] | None = None) -> RunLogs:
    """Read the logs of a run folder, damaged ones as far as possible, and convert all stamps to netem's clock.

    ``wanted`` selects topics, in addition to those of the clocks; without it all but `PICTURES` are read. A recovered
    log replaces the damaged one (`tis.deploy.logs.log_paths`). A side that was killed before the first flush of its
    log leaves an empty file. The logs of a side that was started anew in the run are read as one. Raises `DataError`
    with a fault for each side with a file that is no log of this version.
    """
    release_large_arrays()
    logs, faults = RunLogs(run_dir), list[Fault]()
    wanted = None if wanted is None else {*wanted, *CLOCK_TOPICS}
    for side, paths in log_files(run_dir).items():
        try:
            # reading makes millions of objects and no cycles: the collector would only cost time
            with without_collector():
                logs.sides[side] = load_parts(paths, side, wanted)
                _add_companions(logs.sides[side], run_dir, wanted)
        except DataError as error:
            faults += [replace(fault, where=str(paths[0]), field=_topic(paths, fault)) for fault in error.faults]
    if faults:
        raise DataError(faults)
    return aligned(logs)


def empty_log(side: Side, path: Path, damage: str) -> SideLog:
    """Return the void log of a side that was killed before it wrote anything."""
    return SideLog(side, coverage=Coverage(path.name, damage, unknown=((0, FOREVER),)))


def _topic(paths: Sequence[Path], fault: Fault) -> str:
    """Return the field of a fault on the file, else the topic that the fault names."""
    return fault.field if fault.where in map(str, paths) else fault.where


def aligned(logs: RunLogs) -> RunLogs:
    """Return logs with all stamps on the reference clock."""
    last_ns = {side: log.last_ns for side, log in logs.sides.items()}
    clocks = run_clocks({side: log.rows for side, log in logs.sides.items()}, last_ns, mode_of(logs))
    if clocks.all_shared:
        return replace(logs, clocks=clocks)
    return replace(logs, sides={side: log.aligned(clocks) for side, log in logs.sides.items()}, clocks=clocks)


def scenario_in(logs: RunLogs) -> str | None:
    """Return the scenario (YAML) in the logs, None without any; raises `DataError` when they or their runs differ."""
    run_id_in(logs)
    texts = {
        log.attachments[folder.SCENARIO_FILE]
        for log in logs.sides.values()
        if folder.SCENARIO_FILE in log.attachments
    }
    if len({log.metadata["digest"] for log in logs.sides.values() if "digest" in log.metadata}) > 1:
        raise DataError(Fault(str(logs.run_dir), "", "holds logs of different scenarios"))
    return _decoded(logs, next(iter(texts)), folder.SCENARIO_FILE) if texts else None


def _decoded(logs: RunLogs, data: bytes, name: str) -> str:
    try:
        return data.decode()
    except UnicodeDecodeError:
        raise DataError(Fault(str(logs.run_dir), name, "must be UTF-8 text")) from None


def run_id_in(logs: RunLogs) -> int | None:
    """Return the number of the run that the logs are of, None for a twin; raises `DataError` when they differ."""
    clocks = (part_clock(log.attachments) for log in logs.sides.values())
    found = {clock.run_id for clock in clocks if clock is not None and clock.run_id is not None}
    if len(found) > 1:
        raise DataError(Fault(str(logs.run_dir), "", "holds logs of different runs"))
    return next(iter(found), None)


def mode_of(logs: RunLogs) -> str:
    """Return the mode of the run, live or twin."""
    return next((log.metadata["mode"] for log in logs.sides.values() if "mode" in log.metadata), "live")


def models_in(logs: RunLogs) -> tuple[ArmModel, ...]:
    """Return the models in the patient's log; raises `DataError` when they cannot be read."""
    attached = logs.attachments("patient")
    found = [attached[name] for name in MODEL_FILES if name in attached]
    return parse_models(found[0], "patient.mcap") if found else ()


def origins_in(logs: RunLogs) -> dict[str, Origin]:
    """Return the origins of user-defined estimators in the patient's log; raises `DataError` when damaged."""
    data = logs.attachments("patient").get(USER_CODE_FILE)
    return {} if data is None else parse_origins(data, "patient.mcap")
