"""Replay of touch: the surgeon's hands from the logged forces, and what both sides sent, byte by byte."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from tis.common.messages import Message, Pose, SampledPose, ShownForce, Twist, Wrench
from tis.common.node import Record
from tis.common.records import TICKS
from tis.common.runtime.log_parts import part_clock
from tis.common.runtime.loop import Seat, run
from tis.common.runtime.recordings import load_recording
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.read.load import load_side
from tis.deploy.run.recorded import RecordedBus, RecordedClock, recorded_arrivals
from tis.surgeon_side.build import build_surgeon

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
