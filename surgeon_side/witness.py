"""The witness of a foreign surgeon: it hears what another program sends in the surgeon's place, and writes its log.

It sends nothing. A message of the surgeon counts as sent at the instant in its header; one that netem heard and the
witness did not shows in the books as any other difference does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import sqrt
from typing import Final

from tis.common.channels import HandChannels, Network
from tis.common.device_records import FOREIGN_SURGEON
from tis.common.intake import Accepted, Intake
from tis.common.messages import FeedbackPose, Pose, Vector3
from tis.common.node import Arrival, Record
from tis.common.peer_life import NO_ALARMS, Alarm
from tis.common.records import COUNTERS, TICKS, TRUTH, CounterNote, TickNote, TruthRow
from tis.common.signing import Identity, RunKeys
from tis.common.units import sample_index, sample_instant_ns
from tis.surgeon_side.node import Traffic, rotation_vector, traffic_counters

_MAX_GAP: Final = 10_000
"""Missed ticks that one message can reveal: five minutes at 30 Hz. Beyond, a sample number is no evidence."""


@dataclass
class WitnessNode:
    """Logs a foreign surgeon's samples as sent, its ticks by their instants, and the commanded arm as truth.

    A tick without a sample before a later one counts as missed. Oracle: the log of our own surgeon's messages,
    tests/surgeon_side/test_witness.
    """

    session: str
    hands: Sequence[HandChannels]
    rate_hz: int
    n_ticks: int
    name: str = "surgeon"
    doing: str = ""
    n_missed: int = 0
    answers: Intake[FeedbackPose] = field(init=False)
    samples: Intake[Pose] = field(init=False)

    def __post_init__(self) -> None:
        self.answers = Intake(self.session, [c for hand in self.hands for c in (hand.estimated, hand.measured)])
        self.samples = Intake(self.session, [c for hand in self.hands for c in (hand.command, hand.arm)])
        self._arms = {hand.arm.key(self.session): hand for hand in self.hands}
        self._paces = self.hands[0].command.key(self.session)
        self._newest_truth = dict.fromkeys(self._arms, -1)
        self._k = 0  # the first tick without a sample so far
        self.traffic = {key: Traffic() for key in self.samples.wanted()}

    def remembers(self) -> Sequence[str]:
        """Return no topic."""
        return ()

    def resume(self, last: Mapping[str, bytes]) -> None:
        """Do nothing."""

    def alarms(self) -> Mapping[Alarm, int]:
        """Return none: nobody forges what the surgeon's hand does."""
        return NO_ALARMS

    def believe(self, keys: RunKeys, own: Identity) -> None:
        """Do nothing: a witness has no key, and uses nothing."""

    def join(self, run_id: int, from_ns: int = 0) -> None:
        """Take messages of this run only."""
        self.answers.run_id = self.samples.run_id = run_id
        self._k = max(self._k, sample_index(from_ns, self.rate_hz))

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the surgeon's streams and of the answers to it."""
        return [("west", key) for key in (*self.samples.wanted(), *self.answers.wanted())]

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return no key."""
        return ()

    def next_wake_ns(self) -> int | None:
        """Return None: it only listens."""
        return None

    def wake(self, now_ns: int) -> Sequence[Record]:  # noqa: ARG002  (never due)
        """Do nothing."""
        return ()

    def receive(self, arrival: Arrival) -> Sequence[Record]:
        """Log a message of the surgeon as sent, and an answer as received."""
        if arrival.key not in self.traffic:
            return self.answers.take(arrival)[1]
        accepted, records = self.samples.take(arrival)
        if accepted is None:
            return records
        self.traffic[arrival.key].add(arrival.payload)
        header = accepted.header
        sent = Record(
            arrival.key, header.sent_ns, arrival.payload, accepted.channel.payload, header.sent_ns, header.seq
        )
        return [sent, *self._ticks(arrival.key, accepted), *self._truth(arrival.key, accepted.message)]

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the ticks without a sample at the end, and the counters."""
        n_due = min(sample_index(now_ns, self.rate_hz) + 1, self.n_ticks)
        rest = [self._tick(k, now_ns, missed=True) for k in range(self._k, min(n_due, self._k + _MAX_GAP))]
        notes = [CounterNote(name=name, value=value) for name, value in self.counters().items()]
        return [*rest, *(Record(COUNTERS, now_ns, note) for note in notes)]

    def counters(self) -> dict[str, int]:
        """Return the counters that a surgeon of ours has, as far as they can be known from outside."""
        both = (self.answers, self.samples)
        return {
            FOREIGN_SURGEON: 1,
            "sent": sum(entry.n_packets for entry in self.traffic.values()),
            "received": self.answers.n_accepted,
            "duplicates": self.answers.n_duplicates,
            "conflicting": self.answers.n_conflicting,
            "other_run": sum(intake.n_foreign for intake in both),
            "rejected": sum(intake.n_rejected for intake in both),
            "ticks": self._k,
            "ticks_missed": self.n_missed,
            **traffic_counters(self.traffic),
        }

    def _ticks(self, key: str, accepted: Accepted[Pose]) -> list[Record]:
        """Return the tick of a new sample, and those that were missed before it."""
        k, sent_ns = sample_index(accepted.message.sample_ns, self.rate_hz), accepted.header.sent_ns
        if key != self._paces or not self._k <= k < min(self.n_ticks, self._k + _MAX_GAP):
            return []
        missed = [self._tick(earlier, sent_ns, missed=True) for earlier in range(self._k, k)]
        self._k = k + 1
        return [*missed, self._tick(k, sent_ns, missed=False)]

    def _tick(self, k: int, begin_ns: int, missed: bool) -> Record:
        self.n_missed += missed
        note = TickNote(tick=k, due_ns=sample_instant_ns(k, self.rate_hz), begin_ns=begin_ns, missed=missed)
        return Record(TICKS, begin_ns, note)

    def _truth(self, key: str, pose: Pose) -> list[Record]:
        """Return the commanded arm at a new sample: the truth of a surgeon that nobody has recorded."""
        hand = self._arms.get(key)
        if hand is None or pose.sample_ns <= self._newest_truth[key]:
            return []
        self._newest_truth[key] = pose.sample_ns
        note = TruthRow(
            hand=hand.hand,
            index=sample_index(pose.sample_ns, self.rate_hz),
            sample_ns=pose.sample_ns,
            position_m=pose.position_m,
            rotation_rad=_rotation(pose),
            gripper_rad=pose.gripper_rad,
        )
        return [Record(TRUTH, pose.sample_ns, note)]


def _rotation(pose: Pose) -> Vector3 | None:
    """Return the orientation as a rotation vector; None for a quaternion of length 0."""
    q = pose.orientation
    length = sqrt(q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w)
    return rotation_vector([value / length for value in (q.x, q.y, q.z, q.w)]) if length else None
