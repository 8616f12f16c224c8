"""Noise of the surgeon's sensors: normal errors of the positions that are sent, addressed by sample."""

from dataclasses import dataclass, field
from statistics import NormalDist
from typing import Final, NamedTuple

from common.streams import Stream

_STANDARD: Final = NormalDist()


class Error(NamedTuple):
    """Error of one position, in m."""

    x: float
    y: float
    z: float


@dataclass
class SensorNoise:
    """Independent normal errors of deviation ``std_m`` in each axis, of each sample on each key.

    Sample ``k`` of a key uses elements 3 k, 3 k + 1 and 3 k + 2 of that key's stream, whatever else is sent. So
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
            stream = self._streams[key] = Stream.named(self.seed, f"surgeon/{key}/sensor_noise")
        return Error(*(self.std_m * _STANDARD.inv_cdf(stream.uniform(3 * k + axis)) for axis in range(3)))
