"""The surgeon's samples as messages: the poses of all streams at one instant, each with the samples before it."""

from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

from tis.common.channels import Channel, HandChannels
from tis.common.messages import Pose, Quaternion, SampledPose, Vector3
from tis.common.sources.sensor_noise import Error, SensorNoise
from tis.common.units import sample_instant_ns
from tis.surgeon_side.motion import HandPoses, Placed

NO_ERROR: Final = Error(0.0, 0.0, 0.0)


class SampleMessage(NamedTuple):
    """One sample on one key: the message, and its bytes."""

    channel: Channel
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
                sampled = SampledPose.model_construct(**dict(pose), history=tuple(earlier))
                messages.append(SampleMessage(channel, key, sampled, sampled.payload()))
                earlier.append(pose)
            else:
                messages.append(SampleMessage(channel, key, pose, pose.model_dump_json().encode()))
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
