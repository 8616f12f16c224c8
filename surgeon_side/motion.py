"""The movement that a surgeon sends: master and arm of each hand at a sample; and the samples as messages.

A recorded movement is here, that of live devices in `tis.surgeon_side.live`.
"""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Final, NamedTuple, Protocol

from tis.common.channels import Channel, HandChannels
from tis.common.messages import Pose, Quaternion, SampledPose, Vector3, encode
from tis.common.node import Arrival, Record
from tis.common.sources.sensor_noise import Error, SensorNoise
from tis.common.sources.trajectory import PoseTrack, Recording
from tis.common.units import sample_instant_ns


class Placed(NamedTuple):
    """A pose: position in m, unit quaternion x y z w, gripper angle in rad."""

    position_m: tuple[float, float, float]
    orientation: tuple[float, float, float, float]
    gripper_rad: float


class HandPoses(NamedTuple):
    """Where the master of a hand is, and where its arm is to be."""

    command: Placed
    arm: Placed


class Motion(Protocol):
    """The movement of all hands; `advance` is called for each sample that is taken, before its poses are read."""

    @property
    def channels(self) -> Sequence[HandChannels]:
        """Return the channels of each hand, in the order of the poses."""

    def listens(self) -> Sequence[str]:
        """Return the keys from which the movement comes; none for a recorded one."""

    def take(self, arrival: Arrival) -> None:
        """Take a message from one of these keys; it is used at the next sample."""

    def advance(self, k: int, t_ns: int) -> Sequence[Record]:
        """Move on to sample ``k`` at ``t_ns``; return what is to be logged."""

    def poses(self, k: int) -> Sequence[HandPoses]:
        """Return the poses at sample ``k``, the last one that was advanced to."""

    def truth(self, k: int, is_first: bool) -> Iterator[tuple[int, Sequence[HandPoses]]]:
        """Yield the samples whose poses become known with sample ``k``, taken or missed, each with its number.

        ``is_first``: it is the first of this process, for which those before it may be known, too.
        """

    def counters(self) -> Mapping[str, int]:
        """Return what was counted, by name."""


_MAX_MADE_UP = 10_000
"""Samples before its return that a surgeon started anew logs: five minutes at 30 Hz, ten seconds at 1 kHz."""


class RecordedMotion:
    """The movement in a recording: sample k is row ``start + k``, so truth is known one sample ahead."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self.channels: Sequence[HandChannels] = [hand.channels for hand in recording.hands]
        # A sample is read as truth, as message and as intention: within two ticks.
        self._of_row = lru_cache(maxsize=4)(self._read)

    def listens(self) -> Sequence[str]:
        """Return no key."""
        return ()

    def take(self, arrival: Arrival) -> None:
        """Do nothing: no message belongs to a recording."""

    def advance(self, k: int, t_ns: int) -> Sequence[Record]:  # noqa: ARG002
        """Do nothing: all rows are known."""
        return ()

    def poses(self, k: int) -> Sequence[HandPoses]:
        """Return the poses of row ``start + k``."""
        return self._of_row(self._recording.start + k)

    def _read(self, row: int) -> tuple[HandPoses, ...]:
        hands = self._recording.hands
        return tuple(HandPoses(_placed(hand.command, row), _placed(hand.follower, row)) for hand in hands)

    def truth(self, k: int, is_first: bool) -> Iterator[tuple[int, Sequence[HandPoses]]]:
        """Yield the next sample: truth is interpolated at every tick, the last included.

        A surgeon that was away also tells where the arm was to be meanwhile.
        """
        for index in range(max(0, k - _MAX_MADE_UP), k + 2) if is_first else (k + 1,):
            if self._recording.start + index < len(self._recording):
                yield index, self.poses(index)

    def counters(self) -> Mapping[str, int]:
        """Return nothing."""
        return {}


def _placed(track: PoseTrack, row: int) -> Placed:
    x, y, z = track.position_m[row].tolist()
    qx, qy, qz, qw = track.orientation[row].tolist()
    return Placed((x, y, z), (qx, qy, qz, qw), float(track.gripper_rad[row]))


NO_ERROR: Final = Error(0.0, 0.0, 0.0)


class SampleMessage(NamedTuple):
    """One sample on one key: the message, and its bytes."""

    channel: Channel[Pose]
    key: str
    message: Pose
    content: bytes


class Samples:
    """The samples of a movement on the surgeon's keys; each carries the ``history`` samples taken before it.

    Their positions have the errors of ``noise``, if there is any.
    """

    def __init__(
        self,
        session: str,
        hands: Sequence[HandChannels],
        rate_hz: int,
        history: int = 0,
        noise: SensorNoise | None = None,
    ) -> None:
        self._rate_hz: Final = rate_hz
        self._n_earlier: Final = history
        self._noise: Final = noise
        self._streams: Final = [
            (channel, channel.key(session), deque[Pose](maxlen=history))
            for hand in hands
            for channel in (hand.command, hand.arm)
        ]

    @property
    def all_keys(self) -> list[str]:
        """Keys of all streams."""
        return [key for _, key, _ in self._streams]

    def take(self, k: int, hands: Sequence[HandPoses]) -> list[SampleMessage]:
        """Return the messages of sample ``k``, which is then history; skipped samples never are."""
        sample_ns = sample_instant_ns(k, self._rate_hz)
        placed = [each for poses in hands for each in (poses.command, poses.arm)]
        messages = []
        for (channel, key, earlier), where in zip(self._streams, placed, strict=True):
            error = NO_ERROR if self._noise is None else self._noise.error(key, k)
            pose = pose_at(where, sample_ns, error)
            if self._n_earlier:
                own = pose.sample_ns, pose.position_m, pose.orientation, pose.gripper_rad
                sampled = SampledPose(*own, history=tuple(earlier))
                messages.append(SampleMessage(channel, key, sampled, encode(sampled)))
                earlier.append(pose)
            else:
                messages.append(SampleMessage(channel, key, pose, encode(pose)))
        return messages


def pose_at(where: Placed, sample_ns: int, error_m: Error = NO_ERROR) -> Pose:
    """Return a pose as a message, taken at ``sample_ns`` with an error of its position."""
    x, y, z = where.position_m
    qx, qy, qz, qw = where.orientation
    return Pose(
        sample_ns=sample_ns,
        position_m=Vector3(x=x + error_m.x, y=y + error_m.y, z=z + error_m.z),
        orientation=Quaternion(x=qx, y=qy, z=qz, w=qw),
        gripper_rad=where.gripper_rad,
    )
