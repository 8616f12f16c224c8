"""A recorded bus and clock: what a side heard in a run, and when its ticks began, by which it runs again."""

from bisect import bisect_left
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from msgspec import DecodeError

from tis.common.channels import DESTINATION, VIDEO, Direction, direction_of
from tis.common.messages import Header, Pose, Quaternion, Vector3, decode, encode
from tis.common.node import Arrival, Emission
from tis.common.records import TICKS, TickNote
from tis.common.runtime.loop import Delivery
from tis.common.safety_records import QUARANTINE, STOPS, QuarantineNote, StopNote
from tis.deploy.logs.log_file import LogFile
from tis.deploy.logs.payloads import other_version

_NOBODYS_RAD: Final = 1.234567890123e-9
"""A gripper's angle that no message states: whatever it is in differs from the message that came."""


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


class LateArrival(NamedTuple):
    """A recorded arrival of the instant of a tick, that came when this tick had ended."""

    recv_ns: int
    arrival: Arrival


@dataclass
class RecordedBus:
    """Bus that delivers the recorded arrivals by their effective stamps and drops sent messages.

    ``stop`` stops or releases the arms where a recorded request did: which requests the patient carried out is read
    from the log, as it holds no secrets, by which a patient would decide again.
    """

    arrivals: deque[Arrival | LateArrival | RecordedStop]
    clock: RecordedClock
    stop: Callable[[bool], None]

    def send(self, seat: int, emission: Emission) -> int:  # noqa: ARG002
        """Drop the message."""
        return self.clock.now_ns()

    def wait(self, deadline_ns: int) -> Delivery | None:
        """Return the next arrival stamped at or before the deadline; one that came after its tick, not yet then."""
        while self.arrivals and self.arrivals[0].recv_ns <= deadline_ns:
            if isinstance(self.arrivals[0], LateArrival) and self.arrivals[0].recv_ns == deadline_ns:
                break
            match self.arrivals.popleft():
                case Arrival() as arrival:
                    return Delivery(0, arrival)
                case LateArrival() as late:
                    return Delivery(0, late.arrival)
                case RecordedStop() as stop:
                    self.stop(stop.is_stopped)
        self.clock.pass_to(deadline_ns)
        return None


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


def recorded_arrivals(path: Path, session: str, direction: Direction) -> deque[Arrival | LateArrival | RecordedStop]:
    """Return the arrivals of a side's log from ``direction``, in the order in which they came from the bus.

    An arrival may have the instant of a tick that ended before it: in virtual time a message without a delay answers
    the tick of another side, at the same instant.
    """
    file, found, ended_ns = LogFile(path), deque[Arrival | LateArrival | RecordedStop](), -1
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
            elif key == TICKS:
                try:
                    ended_ns = decode(payload, TickNote).due_ns
                except DecodeError:
                    raise other_version(TICKS) from None
            elif key == QUARANTINE:
                found.extend(_contradiction(payload))
            elif direction_of(key, session) == direction and key != VIDEO.key(session):  # the screen's own
                arrival = Arrival(DESTINATION[direction], key, payload, Header(seq, sent_ns).pack(), log_ns)
                found.append(LateArrival(log_ns, arrival) if log_ns == ended_ns else arrival)
    return found
