"""The surgeon as a state machine: at each tick it sends the masters' poses, and it receives the patient's answers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import atan2, sqrt
from typing import Any, Final, NamedTuple

from tis.common.channels import Network
from tis.common.intake import Intake
from tis.common.messages import CODE_BYTES, HEADER_BYTES, FeedbackPose, Header, Sampled, Twist, Vector3, encode
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.peer_life import NO_ALARMS, Alarm
from tis.common.records import COUNTERS, SENT_BYTES, SENT_PACKETS, TICKS, TRUTH, CounterNote, TickNote, TruthRow
from tis.common.signing import Identity, RunKeys
from tis.common.sources.sensor_noise import SensorNoise
from tis.common.ticker import PlannedPacket, SendPlan, Ticker
from tis.common.units import sample_instant_ns
from tis.surgeon_side.commanded_arm import Servo
from tis.surgeon_side.motion import Motion, SampleMessage, Samples
from tis.surgeon_side.predictive_display import Displays
from tis.surgeon_side.touch import Touch, YieldingMotion


class Redundancy(NamedTuple):
    """Each sample is sent ``copies`` times, ``spacing_ns`` apart, and carries the ``history`` samples before it."""

    copies: int = 1
    spacing_ns: int = 0
    history: int = 0


ONCE: Final = Redundancy()
"""Every sample once, without history."""


def rotation_vector(quaternion: Sequence[float]) -> Vector3:
    """Return a unit quaternion, scalar last, as axis times angle in rad, at most pi (oracle: scipy's rotations)."""
    x, y, z, w = quaternion
    length = sqrt(x * x + y * y + z * z)
    # atan2 is exact for small angles; q and -q are the same rotation, so w < 0 turns the axis.
    scale = 2.0 * atan2(length, abs(w)) / length if length else 2.0
    scale = -scale if w < 0.0 else scale
    return Vector3(x=scale * x, y=scale * y, z=scale * z)


@dataclass
class Traffic:
    """Packets and bytes sent on one key; the bytes are those of payload and attachment."""

    n_packets: int = 0
    n_bytes: int = 0
    attachment_bytes: int = HEADER_BYTES

    def add(self, payload: bytes) -> None:
        """Count a packet with this payload."""
        self.n_packets += 1
        self.n_bytes += len(payload) + self.attachment_bytes


def traffic_counters(traffic: Mapping[str, Traffic]) -> dict[str, int]:
    """Return the counters of the traffic on each key."""
    packets = {f"{SENT_PACKETS}.{key}": entry.n_packets for key, entry in traffic.items()}
    return packets | {f"{SENT_BYTES}.{key}": entry.n_bytes for key, entry in traffic.items()}


@dataclass
class SurgeonNode:
    """Samples a movement: sample i is sent at its sample instant, or counted as missed, never sent late.

    A copy that could not leave before the same copy of the next sample is due is omitted and counted. A missed sample
    was never taken: it has no copies, and no later packet carries it in its history.
    """

    session: str
    motion: Motion
    ticker: Ticker
    redundancy: Redundancy = ONCE
    name: str = "surgeon"
    doing: str = ""
    n_sent: int = 0
    n_copies_missed: int = 0
    noise: SensorNoise | None = None
    servo: Servo | None = None
    """The servo by which the arm follows its set point, where it is known."""
    touch: Touch | None = None
    """What the hands feel, in runs with touch."""
    changes_are_forged: bool = True
    """Whether the network changes no message, so that a wrong code raises an alarm."""
    intake: Intake[FeedbackPose] = field(init=False)

    def __post_init__(self) -> None:
        hands = self.motion.channels
        answers = [channel for hand in hands for channel in (hand.estimated, hand.measured)]
        self.intake = Intake(self.session, answers)
        self._samples = Samples(self.session, hands, self.ticker.rate_hz, self.redundancy.history, self.noise)
        self._answers = frozenset(self.intake.wanted())
        self._displays = Displays(self.session, hands, self.ticker.rate_hz, self.servo)
        self._plan = SendPlan(
            self.ticker.rate_hz, self.ticker.n_ticks, self.redundancy.copies, self.redundancy.spacing_ns
        )
        self._to_repeat: dict[int, list[SampleMessage]] = {}  # samples with copies still to be sent
        motion_keys = [] if self.touch is None else self.touch.motion_keys
        self.traffic = {key: Traffic() for key in (*self._samples.all_keys, *motion_keys)}
        self._first = 0  # the sample with which this process began

    def remembers(self) -> Sequence[str]:
        """Return no topic: the hand moves on by itself."""
        return ()

    def resume(self, last: Mapping[str, bytes]) -> None:
        """Do nothing."""

    def alarms(self) -> Mapping[Alarm, int]:
        """Return whether somebody forges the patient's answers."""
        intakes: list[Intake[Any]] = [self.intake] if self.touch is None else [self.intake, self.touch.intake]
        found = [each.forged_since_ns for each in intakes if each.forged_since_ns is not None]
        return {"forged": min(found)} if found and self.changes_are_forged else NO_ALARMS

    def believe(self, keys: RunKeys, own: Identity) -> None:  # noqa: ARG002  (nobody asks the surgeon to stop)
        """Use only what the patient has signed; count the code of each own message among its bytes."""
        self.intake.keys = keys
        if self.touch is not None:
            self.touch.intake.keys = keys
        for traffic in self.traffic.values():
            traffic.attachment_bytes = HEADER_BYTES + CODE_BYTES

    def join(self, run_id: int, from_ns: int = 0) -> None:
        """Take messages of this run only, and send the samples from ``from_ns`` on: the hand moves on by itself."""
        self.intake.run_id = run_id
        if self.touch is not None:
            self.touch.intake.run_id = run_id
        self.ticker.start_at(from_ns)
        self._first = self.ticker.k
        while (due_ns := self._plan.next_due_ns()) is not None and due_ns < from_ns:
            self._plan.pop()

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the patient's answers, and those that the movement comes from."""
        forces = () if self.touch is None else self.touch.keys
        return [("west", key) for key in (*self.intake.wanted(), *forces, *self.motion.listens())]

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the surgeon's streams, and of its displays."""
        shown = () if self.touch is None else self.touch.shown_keys
        return [("west", key) for key in (*self.traffic, *self._displays.keys, *shown)]

    def next_wake_ns(self) -> int | None:
        """Return the instant of the next packet."""
        return self._plan.next_due_ns()

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Log an answer, and display it from the next tick on; keep a device's pose for the next sample."""
        if self.touch is not None and arrival.key in self.touch.keys:
            return self.touch.take(arrival)
        if arrival.key not in self._answers:
            if self.ticker.next_due_ns() is not None:  # else no sample would take it
                self.motion.take(arrival)
            return ()
        accepted, records = self.intake.take(arrival)
        if accepted is not None:
            self._displays.feedback(arrival.key, accepted.message, arrival.recv_ns)
        return records

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Send the sample and the copies that are due."""
        emissions: list[Output] = []
        displayed: list[Output] = []
        notes: list[Output] = []
        for k in self.ticker.skip_missed(now_ns):
            notes.append(self._tick_note(k, now_ns, missed=True))
            notes += self._truth(k)
        while (due_ns := self._plan.next_due_ns()) is not None and due_ns <= now_ns:
            packet = self._plan.pop()
            if packet.copy > 0:
                messages = self._repeated(packet.k, packet.copy, now_ns)
            elif packet.k == self.ticker.k:
                notes += self.motion.advance(packet.k, packet.due_ns)
                messages = self._sample(self.ticker.begin())
                displayed += self._displays.sampled(packet.k, messages)
                if self.touch is not None:
                    messages = self._feel(self.touch, packet, messages, emissions, displayed)
                notes.append(self._tick_note(packet.k, now_ns))
                notes += self._truth(packet.k)
            else:
                continue
            emissions += [
                self._emission(key, content, channel.payload, packet.seq) for channel, key, _, content in messages
            ]
        # Samples first: neither the display nor logging must delay sending.
        return emissions + displayed + notes

    def _sample(self, k: int) -> list[SampleMessage]:
        """Take sample ``k`` of all streams."""
        messages = self._samples.take(k, self.motion.poses(k))
        if self.redundancy.copies > 1:
            self._to_repeat[k] = messages
        return messages

    def _repeated(self, k: int, copy: int, now_ns: int) -> list[SampleMessage]:
        """Return the messages of copy ``copy`` of sample ``k``; none when the sample or the copy was missed."""
        last = copy == self.redundancy.copies - 1
        messages = self._to_repeat.pop(k, None) if last else self._to_repeat.get(k)
        if messages is None or now_ns >= self._plan.due_ns(k + 1, copy):
            self.n_copies_missed += 1
            return []
        return messages

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the counters."""
        return [Record(COUNTERS, now_ns, CounterNote(name=name, value=n)) for name, n in self.counters().items()]

    def counters(self) -> dict[str, int]:
        """Return the numbers of messages by fate, of missed ticks and copies, and the traffic of each key."""
        return {
            "sent": self.n_sent,
            "received": self.intake.n_accepted,
            "duplicates": self.intake.n_duplicates,
            "conflicting": self.intake.n_conflicting,
            **self.intake.counters(),
            "rejected": self.intake.n_rejected,
            "ticks": self.ticker.k,
            "ticks_missed": self.ticker.n_missed,
            "copies_missed": self.n_copies_missed,
            **self.motion.counters(),
            **({} if self.touch is None else self.touch.counters()),
            **traffic_counters(self.traffic),
        }

    def _feel(
        self, touch: Touch, packet: PlannedPacket, messages: list[SampleMessage], sent: list[Output],
        shown: list[Output],
    ) -> list[SampleMessage]:  # fmt: skip
        """Feel the forces of a tick; return the sample's messages but for those that a deadband keeps back."""
        motion, k = self.motion, packet.k
        intention = motion.intention if isinstance(motion, YieldingMotion) else motion
        moves, forces, kept = touch.tick(k, packet.due_ns, motion.poses(k), intention.poses(k))
        sent += [self._emission(key, encode(twist), Twist, k) for key, twist in moves]
        shown += forces
        return [message for message in messages if message.key not in kept]

    def _emission(self, key: str, content: bytes, payload: type[Sampled], seq: int) -> Emission:
        def on_sent(sent_ns: int) -> Sequence[Record]:
            self.n_sent += 1
            self.traffic[key].add(content)
            return (Record(key, sent_ns, content, payload, sent_ns, seq),)

        return Emission("west", key, content, Header(seq), on_sent)

    def _tick_note(self, k: int, begin_ns: int, missed: bool = False) -> Record:
        note = TickNote(tick=k, due_ns=self.ticker.due_ns(k), begin_ns=begin_ns, missed=missed)
        return Record(TICKS, begin_ns, note)

    def _truth(self, k: int) -> list[Record]:
        """Log the arm at the samples that are known with sample ``k``."""
        records = []
        for index, hands in self.motion.truth(k, k == self._first):
            sample_ns = sample_instant_ns(index, self.ticker.rate_hz)
            for channels, (_, arm) in zip(self.motion.channels, hands, strict=True):
                x, y, z = arm.position_m
                note = TruthRow(
                    hand=channels.hand,
                    index=index,
                    sample_ns=sample_ns,
                    position_m=Vector3(x=x, y=y, z=z),
                    rotation_rad=rotation_vector(arm.orientation),
                    gripper_rad=arm.gripper_rad,
                )
                records.append(Record(TRUTH, sample_ns, note))
        return records
