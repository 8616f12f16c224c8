"""The surgeon as a state machine: at each tick it sends where the masters are, and it listens to the answers."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from common.channels import Channel, HandChannels, Network
from common.header import Header
from common.intake import Intake
from common.messages import Pose, Quaternion, Vector3
from common.node import Arrival, Emission, Output, Record
from common.records import COUNTERS, TICKS, TRUTH, CounterNote, TickNote, TruthRow
from common.sources.trajectory import HandRecording, PoseTrack, Recording
from common.ticker import Ticker
from common.units import sample_instant_ns


def pose_at(track: PoseTrack, row: int, sample_ns: int) -> Pose:
    """Return one row of a track as a message, taken at ``sample_ns``."""
    x, y, z = track.position_m[row].tolist()
    qx, qy, qz, qw = track.orientation[row].tolist()
    return Pose(
        sample_ns=sample_ns,
        position_m=Vector3(x=x, y=y, z=z),
        orientation=Quaternion(x=qx, y=qy, z=qz, w=qw),
        gripper_rad=float(track.gripper_rad[row]),
    )


@dataclass
class SurgeonNode:
    """Plays a recording: sample i goes out at its sample instant, or is missed and counted, never sent late."""

    session: str
    recording: Recording
    ticker: Ticker
    name: str = "surgeon"
    n_sent: int = 0
    intake: Intake = field(init=False)

    def __post_init__(self) -> None:
        answers = [c for hand in self.recording.hands for c in (hand.channels.estimated, hand.channels.measured)]
        self.intake = Intake(self.session, answers)
        self._hands: list[tuple[HandRecording, HandChannels]] = [
            (hand, hand.channels) for hand in self.recording.hands
        ]
        self._seq = 0

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the patient's answers."""
        return [("west", key) for key in self.intake.wanted()]

    def next_wake_ns(self) -> int | None:
        """Return the instant of the next sample."""
        return self.ticker.next_due_ns()

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Log an answer; the round trip is computed from the log."""
        _, records = self.intake.take(arrival)
        return records

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Send the sample that is due."""
        outputs: list[Output] = []
        for k in self.ticker.skip_missed(now_ns):
            outputs.append(self._tick_note(k, now_ns, missed=True))
            outputs += self._truth(k)
        if self.ticker.next_due_ns() is None:
            return outputs
        k = self.ticker.begin()
        sample_ns = self.ticker.due_ns(k)
        row = self.recording.start + k
        for hand, channels in self._hands:
            outputs.append(self._emission(channels.command, pose_at(hand.command, row, sample_ns), k))
            outputs.append(self._emission(channels.arm, pose_at(hand.follower, row, sample_ns), k))
        outputs.append(self._tick_note(k, now_ns))
        outputs += self._truth(k)
        return outputs

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the counters."""
        return [
            Record(COUNTERS, now_ns, CounterNote(name=name, value=value)) for name, value in self.counters().items()
        ]

    def counters(self) -> dict[str, int]:
        """Return messages sent, accepted, duplicated, rejected, and missed ticks."""
        return {
            "sent": self.n_sent,
            "received": self.intake.n_accepted,
            "duplicates": self.intake.n_duplicates,
            "rejected": self.intake.n_rejected,
            "ticks": self.ticker.k,
            "ticks_missed": self.ticker.n_missed,
        }

    def _emission(self, channel: Channel, pose: Pose, seq: int) -> Emission:
        key = channel.key(self.session)
        payload = pose.model_dump_json().encode()

        def on_sent(sent_ns: int) -> Sequence[Record]:
            self.n_sent += 1
            return (Record(key, sent_ns, payload, channel.payload, sent_ns, seq),)

        return Emission("west", key, payload, Header(seq), on_sent)

    def _tick_note(self, k: int, begin_ns: int, missed: bool = False) -> Record:
        note = TickNote(tick=k, due_ns=self.ticker.due_ns(k), begin_ns=begin_ns, missed=missed)
        return Record(TICKS, begin_ns, note)

    def _truth(self, k: int) -> list[Record]:
        """Log the recorded arm one sample ahead, so that it can be interpolated at every tick, the last one too."""
        indices = (0, 1) if k == 0 else (k + 1,)
        records = []
        for hand, _ in self._hands:
            for index in indices:
                row = self.recording.start + index
                if row >= len(self.recording):
                    continue
                sample_ns = sample_instant_ns(index, self.ticker.rate_hz)
                x, y, z = hand.follower.position_m[row].tolist()
                position_m = Vector3(x=x, y=y, z=z)
                note = TruthRow(hand=hand.hand, index=index, sample_ns=sample_ns, position_m=position_m)
                records.append(Record(TRUTH, sample_ns, note))
        return records
