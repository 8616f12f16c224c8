"""A camera of another program: each frame that it publishes crosses the network in fragments, as the drawn ones do.

The program publishes a whole frame in a message and needs neither the run's number nor its clock; cut here, the frame
is lost in parts as any, and is signed, numbered and logged by the patient's side.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Final, get_args

from msgspec import DecodeError, Meta

from tis.common.channels import VIDEO, HandChannels, Network, camera_key
from tis.common.messages import Message, decode
from tis.common.node import Arrival, Output, Record
from tis.common.records import COUNTERS, CounterNote
from tis.common.scenario import Scenario
from tis.common.scenario.sight import SightPart
from tis.common.sight.codec import is_key
from tis.common.sight.stamp import NO_COMMAND
from tis.common.sight_records import CameraNote, CameraRefusal
from tis.common.units import NS_PER_S, s_to_ns
from tis.patient_side.camera import LEAST_BETWEEN_NS, messages

_MAX_AGE_NS: Final = 10 * NS_PER_S
_MAX_STAMP_S: Final = 1 << 32


class Timestamp(Message, frozen=True):
    """An instant since 1970, as foxglove's schemas have it in JSON."""

    sec: Annotated[int, Meta(ge=0, le=_MAX_STAMP_S, description="Seconds since 1970.")]
    nsec: Annotated[int, Meta(ge=0, lt=NS_PER_S, description="Nanoseconds of that second.")]


class ForeignFrame(Message, frozen=True, kw_only=True):
    """A foxglove.CompressedImage (jpeg) or foxglove.CompressedVideo (h264) in JSON: one frame."""

    timestamp: Annotated[
        Timestamp | None,
        Meta(description="When it was captured, by the calendar clock of the patient's host; null: at its arrival."),
    ] = None
    frame_id: Annotated[str, Meta(description="Frame of reference; the testbed uses none.")] = ""
    data: Annotated[
        bytes, Meta(min_length=1, description="The frame, base64: a JPEG image, or an access unit after Annex B.")
    ]
    format: Annotated[str, Meta(description="jpeg or h264, that of sight.codec.")]


@dataclass
class ExternalCamera:
    """Sends each frame as it comes. What is none, or comes too fast, is counted and never raises.

    Oracle: messages with literal instants, test_external_camera.
    """

    session: str
    sight: SightPart
    until_ns: int
    """Run time after which nothing is sent, as what then crosses might not arrive before the run's end."""
    name: str = "camera"
    n_frames: int = 0
    n_fragments: int = 0
    n_undated: int = 0
    """Frames without a timestamp, or with one that cannot be true: the capture is then taken for their arrival."""
    refused: Counter[CameraRefusal] = field(default_factory=Counter)
    _epoch_unix_ns: int = 0

    def __post_init__(self) -> None:
        self._key, self._heard = VIDEO.key(self.session), camera_key(self.session)

    def join(self, run_id: int, from_ns: int = 0, epoch_unix_ns: int = 0) -> None:  # noqa: ARG002  (it hears no run)
        """Give numbers above all before ``from_ns``; the run began at ``epoch_unix_ns`` since 1970."""
        self._epoch_unix_ns = epoch_unix_ns
        if from_ns:
            self.n_frames, self.n_fragments = self.sight.last_frame(from_ns) + 1, from_ns // LEAST_BETWEEN_NS

    def believe(self, own: bytes, other: bytes) -> None:
        """Believe what comes on the camera's key, which only the patient's network has."""

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the key of the program's frames."""
        return [("east", self._heard)]

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return the key of the picture."""
        return [("east", self._key)]

    def next_wake_ns(self) -> int | None:
        """Return None: a frame is sent when it comes."""
        return None

    def wake(self, now_ns: int) -> Sequence[Output]:  # noqa: ARG002
        """Send nothing."""
        return ()

    def receive(self, arrival: Arrival) -> Iterator[Output]:
        """Send a frame in fragments."""
        if arrival.recv_ns >= self.until_ns:
            return
        try:
            frame = decode(arrival.payload, ForeignFrame)
        except DecodeError:
            self.refused["undecodable"] += 1
            return
        if frame.format != self.sight.codec:
            self.refused["other_format"] += 1
        elif self.n_frames > self.sight.last_frame(arrival.recv_ns):
            self.refused["flooded"] += 1
        else:
            yield from self._sent(frame.data, self._captured_ns(frame.timestamp, arrival.recv_ns))

    def _captured_ns(self, stamp: Timestamp | None, recv_ns: int) -> int:
        """Return when a frame was captured, in run time: as its timestamp says where that can be true."""
        if stamp is not None:
            captured_ns = stamp.sec * NS_PER_S + stamp.nsec - self._epoch_unix_ns
            if max(recv_ns - _MAX_AGE_NS, 0) <= captured_ns <= recv_ns:
                return captured_ns
        self.n_undated += 1
        return recv_ns

    def _sent(self, data: bytes, captured_ns: int) -> Iterator[Output]:
        note = CameraNote(
            frame=self.n_frames,
            captured_ns=captured_ns,
            command=NO_COMMAND,
            left_x=None,
            left_y=None,
            right_x=None,
            right_y=None,
            is_key=self.sight.codec == "jpeg" or is_key(data),
            n_bytes=len(data),
            n_fragments=-(-len(data) // self.sight.fragment_bytes),
            first_seq=self.n_fragments,
            sent_ns=captured_ns,
        )
        self.n_frames += 1
        self.n_fragments += note.n_fragments
        yield from messages(self._key, self.sight, note, data)

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the counters."""
        return [Record(COUNTERS, now_ns, CounterNote(name=name, value=n)) for name, n in self.counters().items()]

    def counters(self) -> dict[str, int]:
        """Return the numbers of frames, of their fragments, and of what was not used by reason."""
        return {
            "video_frames": self.n_frames,
            "video_fragments": self.n_fragments,
            "camera_undated": self.n_undated,
            **{f"camera_{reason}": self.refused[reason] for reason in get_args(CameraRefusal)},
        }


def build_external_camera(scenario: Scenario, hands: Sequence[HandChannels]) -> ExternalCamera:  # noqa: ARG001
    """Return what sends the frames of an external camera, whatever arms there are."""
    assert scenario.sight is not None
    return ExternalCamera(scenario.session, scenario.sight, s_to_ns(scenario.duration_s))
