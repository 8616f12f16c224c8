"""Noise of sensors: normal errors of positions, addressed by sample; of those that are sent, and of training rows."""

from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Final, NamedTuple

from tis.common.sources.trajectory import Array, PoseTrack, Recording
from tis.common.streams import Stream

_STANDARD: Final = NormalDist()


class Error(NamedTuple):
    """Error of one position, in m."""

    x: float
    y: float
    z: float


@dataclass
class SensorNoise:
    """Independent normal errors of deviation ``std_m`` in each axis, of each sample on each key.

    Sample ``k`` of a key uses elements 3 k, 3 k + 1 and 3 k + 2 of that key's stream, whatever else is drawn. So
    copies and the history of later packets carry the same error, and a twin repeats it bit for bit. Oracle: the
    moments of the errors, and a sample that is taken alone, test_sensor_noise.
    """

    seed: int
    std_m: float
    _streams: dict[str, Stream] = field(default_factory=dict, repr=False)

    def error(self, key: str, k: int) -> Error:
        """Return the error of sample ``k`` on a key."""
        stream = self._streams.get(key)
        if stream is None:
            stream = self._streams[key] = _stream(self.seed, key)
        return Error(*(self.std_m * _STANDARD.inv_cdf(stream.uniform(3 * k + axis)) for axis in range(3)))


def with_noise(recording: Recording, std_m: float, seed: int) -> Recording:
    """Return a recording with errors of its positions, as sensors of that deviation would have recorded it.

    Row ``k`` of a device has the error of sample ``k`` on the key ``LABEL/DEVICE``; with a deviation of 0 the
    recording is unchanged. Velocities, which are columns of their own, stay. Oracle: `SensorNoise`,
    test_sensor_noise.
    """
    if std_m == 0.0:
        return recording

    def noisy(track: PoseTrack, device: str) -> PoseTrack:
        return replace(
            track, position_m=track.position_m + _errors(seed, f"{recording.label}/{device}", track, std_m)
        )

    hands = tuple(
        replace(hand, command=noisy(hand.command, f"{hand.hand} master"), follower=noisy(hand.follower, hand.arm))
        for hand in recording.hands
    )
    return replace(recording, hands=hands)


def _errors(seed: int, key: str, track: PoseTrack, std_m: float) -> Array:
    """Return the errors (N, 3) of the first samples on a key, in m."""
    from scipy.special import ndtri  # late: it takes long to load, and runs without such noise do not need it

    n = len(track)
    errors: Array = std_m * ndtri(_stream(seed, key).uniforms(0, 3 * n)).reshape(n, 3)
    return errors


def _stream(seed: int, key: str) -> Stream:
    return Stream.named(seed, f"surgeon/{key}/sensor_noise")
