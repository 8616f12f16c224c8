"""Logs written record by record, so that every figure of a report can be worked out on paper."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from msgspec.structs import asdict
from numpy.typing import ArrayLike

from tests.nodes import a_pose
from tis.common.channels import Direction, Hand, Side
from tis.common.host_records import CLOCK, ClockNote
from tis.common.messages import FeedbackPose, Vector3, encode
from tis.common.node import Record
from tis.common.records import (
    COUNTERS,
    ESTIMATES,
    FATES,
    FRESH,
    QUEUES,
    REJECTED,
    RELEASES,
    TICKS,
    TRUTH,
    CounterNote,
    Departure,
    EstimateNote,
    FateBatch,
    FreshNote,
    Outcome,
    QueueNote,
    Rejected,
    ReleaseBatch,
    TickNote,
    TruthRow,
)
from tis.common.runtime.mcap_log import McapLog
from tis.common.scenario import Scenario
from tis.common.scenario.reading import build_scenario
from tis.deploy.logs.read.load import RunLogs, load_run

MS = 1_000_000
COMMAND = "tis/MTML/measured_cp"
ARM = "tis/PSM2/setpoint_cp"
ESTIMATED = "tis/PSM2/estimated_cp"

Position = tuple[float, float, float]


def ints(values: ArrayLike) -> tuple[int, ...]:
    """Return whole numbers of an array as a record holds them."""
    return tuple(np.asarray(values, dtype=np.int64).tolist())


def a_scenario(duration_s: float = 0.1, **changes: object) -> Scenario:
    """Three samples at 30 Hz, the left hand."""
    raw = {"version": 1, "name": "by_hand", "duration_s": duration_s, "source": {"kind": "synthetic"}}
    return build_scenario({**raw, **changes}, "by_hand.yaml")


def message(key: str, seq: int, sent_ms: float, log_ms: float | None = None, sample_ms: float = 0.0) -> Record:
    """A pose as its sender logs it, or with ``log_ms`` as its receiver does."""
    pose = a_pose(sample_ns=round(sample_ms * MS))
    sent_ns = round(sent_ms * MS)
    log_ns = sent_ns if log_ms is None else round(log_ms * MS)
    return Record(key, log_ns, encode(pose), type(pose), sent_ns, seq)


def answer(tick: int, sent_ms: float, command_ms: float | None, log_ms: float | None = None) -> Record:
    """The patient's estimate, which answers the command sampled at ``command_ms``."""
    command_ns = None if command_ms is None else round(command_ms * MS)
    pose = FeedbackPose(**asdict(a_pose()), tick=tick, command_sample_ns=command_ns)
    sent_ns = round(sent_ms * MS)
    log_ns = sent_ns if log_ms is None else round(log_ms * MS)
    return Record(ESTIMATED, log_ns, encode(pose), FeedbackPose, sent_ns, tick)


def fate(
    key: str,
    seq: int,
    offered_ms: float,
    delay_ms: float | None,
    outcome: Outcome = "deliver",
    foreign: bool = False,
    direction: Direction = "forward",
    n_bytes: int = 100,
    copies: int = 0,
    flipped: int = 0,
) -> Record:
    """A batch of one packet."""
    offered_ns, delay_ns = round(offered_ms * MS), round((delay_ms or 0) * MS)
    batch = FateBatch(
        direction=direction,
        key=key,
        foreign=foreign,
        seq=(seq,),
        offered_ns=(offered_ns,),
        outcome=(outcome,),
        delay_ns=(delay_ns,),
        release_ns=(offered_ns + delay_ns if outcome == "deliver" else 0,),
        n_bytes=(n_bytes,),
        copies=(copies,),
        flipped=(flipped,),
    )
    return Record(FATES, offered_ns, batch)


def release(
    key: str,
    seq: int,
    offered_ms: float,
    due_ms: float,
    left_ms: float,
    departure: Departure = "released",
    foreign: bool = False,
    direction: Direction = "forward",
    copy_index: int = 0,
    queued_ms: float = 0,
) -> Record:
    """A batch of one packet; what was dropped after all was dropped at ``left_ms``."""
    left_ns = round(left_ms * MS)
    batch = ReleaseBatch(
        direction=direction,
        key=key,
        foreign=foreign,
        seq=(seq,),
        copy_index=(copy_index,),
        offered_ns=(round(offered_ms * MS),),
        release_ns=(round(due_ms * MS),),
        released_ns=(left_ns if departure == "released" else 0,),
        departure=(departure,),
        queued_ns=(round(queued_ms * MS),),
    )
    return Record(RELEASES, left_ns, batch)


def crossing(key: str, seq: int, sent_ms: float, direction: Direction = "forward") -> list[Record]:
    """What netem logs of a packet that it delays by 10 ms exactly, offered when it was sent."""
    return [
        fate(key, seq, sent_ms, 10, direction=direction),
        release(key, seq, sent_ms, sent_ms + 10, sent_ms + 10, direction=direction),
    ]


def tick(k: int, due_ms: float, begin_ms: float, missed: bool = False) -> Record:
    note = TickNote(tick=k, due_ns=round(due_ms * MS), begin_ns=round(begin_ms * MS), missed=missed)
    return Record(TICKS, note.begin_ns, note)


def fresh(k: int, seq: int, sample_ms: float, key: str = COMMAND, hand: Hand = "left") -> Record:
    return Record(FRESH, 0, FreshNote(tick=k, hand=hand, key=key, seq=seq, sample_ns=round(sample_ms * MS)))


def estimate(
    k: int, t_ms: float, name: str, position_m: Position | None, hand: Hand = "left", step_ns: int = 0
) -> Record:
    point = None if position_m is None else Vector3(x=position_m[0], y=position_m[1], z=position_m[2])
    note = EstimateNote(tick=k, t_ns=round(t_ms * MS), hand=hand, estimator=name, position_m=point, step_ns=step_ns)
    return Record(f"{ESTIMATES}/{name}", note.t_ns, note)


def truth(index: int, sample_ms: float, position_m: Position, hand: Hand = "left") -> Record:
    point = Vector3(x=position_m[0], y=position_m[1], z=position_m[2])
    note = TruthRow(hand=hand, index=index, sample_ns=round(sample_ms * MS), position_m=point)
    return Record(TRUTH, note.sample_ns, note)


def counter(name: str, value: int) -> Record:
    return Record(COUNTERS, 0, CounterNote(name=name, value=value))


def queue(at_ms: float, n_packets: int, n_bytes: int, direction: Direction = "forward") -> Record:
    note = QueueNote(direction=direction, at_ns=round(at_ms * MS), n_packets=n_packets, n_bytes=n_bytes)
    return Record(QUEUES, note.at_ns, note)


def rejected(key: str, recv_ms: float) -> Record:
    note = Rejected(key=key, recv_ns=round(recv_ms * MS), reason="undecodable", head_hex="")
    return Record(REJECTED, note.recv_ns, note)


ONE_CLOCK = Record(
    CLOCK, 0, ClockNote(boot_id="one", reference_boot_id="one", shared=True, epoch_ns=0, reference_epoch_ns=0)
)


def write_log(
    run_dir: Path,
    side: Side,
    records: Sequence[Record],
    metadata: Mapping[str, str] | None = None,
    files: Mapping[str, bytes] | None = None,
) -> None:
    (run_dir / f"{side}.mcap").unlink(missing_ok=True)
    with McapLog(run_dir / f"{side}.mcap", {"side": side} | dict(metadata or {})) as log:
        for name, data in (files or {}).items():
            log.attach(name, data)
        for record in records:
            log.record(record)


def cut_log(run_dir: Path, name: str, records: Sequence[Record], n_whole: int) -> None:
    """Write a log with each record a chunk of its own, and tear it within the record behind ``n_whole`` of them."""
    path = run_dir / f"{name}.mcap"
    path.unlink(missing_ok=True)
    with McapLog(path, {"side": name.partition("_")[0]}) as log:
        for record in records[:n_whole]:
            log.record(record)
            log.flush()
        at = path.stat().st_size
        for record in records[n_whole:]:
            log.record(record)
            log.flush()
    path.write_bytes(path.read_bytes()[: at + 20])


def write_run(
    run_dir: Path, surgeon: Sequence[Record] = (), netem: Sequence[Record] = (), patient: Sequence[Record] = ()
) -> RunLogs:
    """Write the three logs, of one host, and read them back."""
    write_log(run_dir, "surgeon", [ONE_CLOCK, *surgeon])
    write_log(run_dir, "netem", netem)
    write_log(run_dir, "patient", [ONE_CLOCK, *patient])
    return load_run(run_dir)
