"""Messages for viewers in the merged file: their topics, their models, and the thinning of record streams for them.

A side's topic T becomes ``/SIDE/T``, as two sides log the same keys. Messages for viewers have a plain name for the
scenario's first hand, and ``NAME/HAND`` for the second.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol, overload

import numpy as np

from tis.common.channels import FOLLOWER, Arm, Direction, Hand, HandChannels, Side, hand_channels
from tis.common.messages import Message, Vector3
from tis.common.runtime.chunk_writer import MESSAGE_HEAD_BYTES, Ints
from tis.common.scenario import Scenario

MTM: Final = "/mtm"
PSM: Final = "/psm"
PLANT_ARM: Final = "/plant"
SET_POINT: Final = "/set_point"
ESTIMATE: Final = "/estimates"
PATH: Final = "/paths"
TRANSFORMS: Final = "/tf"
LOG: Final = "/log"
ERROR: Final = "/metrics/error"
TURN_ERROR: Final = "/metrics/orientation_error"
AGE: Final = "/metrics/age"
DELAY: Final = "/metrics/delay"
FORCE: Final = "/forces"
FORCE_SIZE: Final = "/metrics/force"
CAMERA_VIDEO: Final = "/camera"
TRUTH_NAME: Final = "truth"


def merged_topic(side: Side, topic: str) -> str:
    """Return the topic of a side's record in the merged file."""
    return f"/{side}/{topic.lstrip('/')}"


@dataclass(frozen=True)
class RunTopics:
    """The channels of a run by hand, the first hand first."""

    session: str
    rate_hz: int
    channels: Sequence[HandChannels]
    active_orientation: str = "hold"

    @classmethod
    def of(cls, scenario: Scenario, arms: Mapping[Hand, Arm]) -> "RunTopics":
        """Return a scenario's topics; ``arms`` maps hands to the arms that they drive, where known."""
        rows = [hand_channels(hand, arms.get(hand, FOLLOWER[hand])) for hand in scenario.source.hands]
        return cls(scenario.session, scenario.rate_hz, rows, scenario.patient.orientation.active)

    def of_hand(self, topic: str, hand: Hand) -> str:
        """Return a drawn topic's name for one hand."""
        return topic if hand == self.channels[0].hand else f"{topic}/{hand}"

    @property
    def hands(self) -> tuple[Hand, ...]:
        """Return the hands in the scenario's order."""
        return tuple(row.hand for row in self.channels)


class ErrorSample(Message, frozen=True):
    """How far an estimate is from truth at its tick (truth interpolated between samples), to 0.1 um."""

    error_mm: float


class TurnErrorSample(Message, frozen=True):
    """The angle between an estimated orientation and the true one at its tick."""

    error_deg: float


class AgeSample(Message, frozen=True):
    """The age at a tick: its instant minus that of the freshest sample, clocks aligned."""

    age_ms: float


class DelaySample(Message, frozen=True):
    """One message's way from sending to arrival, clocks aligned."""

    direction: Direction
    key: str
    seq: int
    delay_ms: float


class ForceSample(Message, frozen=True):
    """The force on a tool or on a hand, and its size."""

    size_n: float
    force_n: Vector3


DRAWN_HZ: Final = 100
"""Highest rate of drawn messages; faster streams are thinned, the logs' own records never."""
FRAMES_HZ: Final = 10


class Drawn(NamedTuple):
    """One message to add; ``kind`` is a name in `foxglove.SCHEMAS`, or the model of a JSON payload."""

    topic: str
    kind: str | type[Message]
    log_ns: int
    payload: bytes


def xyz(point: Mapping[str, float]) -> tuple[float, float, float]:
    """Return a message's vector as a tuple."""
    return point["x"], point["y"], point["z"]


class Payloads(Sequence[bytes]):
    """The payloads of some message records, by index; each is sliced at access."""

    def __init__(self, records: Sequence[bytes], which: Ints) -> None:
        self._records, self._which = records, which

    def __len__(self) -> int:
        return len(self._which)

    @overload
    def __getitem__(self, i: int) -> bytes: ...
    @overload
    def __getitem__(self, i: slice) -> "Payloads": ...
    def __getitem__(self, i: int | slice) -> "bytes | Payloads":
        if isinstance(i, slice):
            return Payloads(self._records, self._which[i])
        return self._records[int(self._which[i])][MESSAGE_HEAD_BYTES:]

    def __iter__(self) -> Iterator[bytes]:
        records = self._records
        return (records[i][MESSAGE_HEAD_BYTES:] for i in self._which.tolist())


class Records(NamedTuple):
    """N records of one channel in order of aligned time: stamps and sequence numbers (N,), and payloads."""

    log_ns: Ints
    publish_ns: Ints
    seq: Ints
    payloads: Sequence[bytes]


_NONE: Final = np.empty(0, dtype=np.int64)
NO_RECORDS: Final = Records(_NONE, _NONE, _NONE, ())


class Stream(Protocol):
    """A stream that draws the records of one side and topic."""

    def take(self, records: Records) -> Iterable[Drawn]:
        """Take the next records; return messages for them, or for earlier ones."""
        ...


class EveryNth:
    """Thins a stream of ``rate_hz`` to at most ``max_hz`` by picking every n-th record.

    Records of several hands alternate: a group of ``n_together`` is kept or dropped as a whole.
    """

    def __init__(self, rate_hz: int, n_together: int = 1, max_hz: int = DRAWN_HZ) -> None:
        self._every = -(-rate_hz // max_hz)
        self._n_together, self._n_seen = n_together, 0

    def of(self, n_records: int) -> Ints:
        """Return the indices to keep of the next ``n_records``."""
        group = (self._n_seen + np.arange(n_records)) // self._n_together
        self._n_seen += n_records
        return np.flatnonzero(group % self._every == 0)
