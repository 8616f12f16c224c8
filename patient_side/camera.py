"""The camera: at its own rate it draws the arms as they are measured, and sends the picture in fragments.

It hears the patient's measured poses as any program on that network does, so it can run as a process of its own.
"""

from base64 import b64encode
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from msgspec.structs import replace as replaced

from tis.common.channels import VIDEO, Hand, HandChannels, Network
from tis.common.intake import Intake
from tis.common.messages import FeedbackPose, Fragment, Header, encode, position_m
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.records import COUNTERS, CounterNote
from tis.common.scenario import Scenario
from tis.common.scenario.sight import SightPart
from tis.common.sight.codec import Encoder, encoder_of
from tis.common.sight.fragments import cut
from tis.common.sight.picture import PATH_FRAMES, Pixel, Scene, Tools, draw, scene_of
from tis.common.sight.stamp import NO_COMMAND, Stamp
from tis.common.sight_records import CAMERA, PICTURES, CameraNote, EncodedFrame
from tis.common.signing import RunKeys
from tis.common.ticker import Ticker
from tis.common.units import ms_to_ns, sample_index

LEAST_BETWEEN_NS: Final = 4_000
"""More time passes on average between two fragments, so that a camera that comes back has new numbers for them."""


@dataclass
class _Seen:
    """An arm as the camera sees it: where it is, where it was first, and the newest command behind that."""

    column: int
    first_m: tuple[float, float, float]
    at_m: tuple[float, float, float]
    tick: int
    command_ns: int | None


@dataclass
class CameraNode:
    """Frame k is captured at its instant and shows exactly what arrived by then; a frame that is missed is not sent.

    Frames are numbered in the order in which they are sent.
    """

    session: str
    hands: Sequence[HandChannels]
    sight: SightPart
    scene: Scene
    rate_hz: int
    ticker: Ticker
    encoder: Encoder
    name: str = "camera"
    n_frames: int = 0
    n_fragments: int = 0
    intake: Intake[FeedbackPose] = field(init=False)

    def __post_init__(self) -> None:
        self.intake = Intake(self.session, [hand.measured for hand in self.hands])
        n = len(self.hands)
        self._hand_of: dict[str, tuple[Hand, int]] = {
            hand.measured.key(self.session): (hand.hand, (2 * i + 1) * self.scene.width // (2 * n))
            for i, hand in enumerate(self.hands)
        }
        self._seen: dict[Hand, _Seen] = {}
        self._path: deque[Tools] = deque(maxlen=PATH_FRAMES)
        self._key = VIDEO.key(self.session)

    def join(self, run_id: int, from_ns: int = 0, epoch_unix_ns: int = 0) -> None:  # noqa: ARG002
        """Take poses of this run only, and send frames from ``from_ns`` on, above all numbers before."""
        self.intake.run_id = run_id
        self.ticker.start_at(from_ns)
        self.n_frames, self.n_fragments = self.ticker.k, from_ns // LEAST_BETWEEN_NS

    def believe(self, own: bytes, other: bytes) -> None:  # noqa: ARG002  (it hears its own side only)
        """Use only poses that are signed under the patient's key, ``own``."""
        self.intake.keys = self.intake.keys or RunKeys()
        self.intake.keys.agree(own, own)

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return the keys of the measured poses."""
        return [("east", key) for key in self.intake.wanted()]

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return the key of the picture."""
        return [("east", self._key)]

    def next_wake_ns(self) -> int | None:
        """Return the instant of the next frame."""
        return self.ticker.next_due_ns()

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Keep an arm's newest pose; the patient logs the message, and the camera what it shows of it."""
        accepted, _ = self.intake.take(arrival)
        if accepted is not None:
            hand, column = self._hand_of[arrival.key]
            pose, known = accepted.message, self._seen.get(hand)
            at_m = position_m(pose)
            if known is None:
                known = self._seen[hand] = _Seen(column, at_m, at_m, pose.tick, pose.command_sample_ns)
            if pose.tick >= known.tick:
                known.at_m, known.tick, known.command_ns = at_m, pose.tick, pose.command_sample_ns
        return ()

    def wake(self, now_ns: int) -> Iterator[Output]:
        """Capture, encode and send the frame that is due."""
        self.ticker.skip_missed(now_ns)
        if self.ticker.next_due_ns() is None:
            return
        captured_ns = self.ticker.due_ns(self.ticker.begin())
        frame, self.n_frames = self.n_frames, self.n_frames + 1
        tools, command = self._tools(), self._command()
        self._path.append(tools)
        encoded = self.encoder.encode(draw(self.scene, Stamp(frame, command), list(self._path)))
        (left, right), first = tools, self.n_fragments
        note = CameraNote(
            frame=frame,
            captured_ns=captured_ns,
            command=command,
            left_x=None if left is None else left[0],
            left_y=None if left is None else left[1],
            right_x=None if right is None else right[0],
            right_y=None if right is None else right[1],
            is_key=encoded.is_key,
            n_bytes=len(encoded.data),
            n_fragments=-(-len(encoded.data) // self.sight.fragment_bytes),
            first_seq=first,
            sent_ns=captured_ns,
        )
        self.n_fragments += note.n_fragments
        yield from messages(self._key, self.sight, note, encoded.data)

    def _tools(self) -> Tools:
        """Return where the tools are seen, left and right."""
        tips: dict[Hand, Pixel] = {
            hand: self.scene.pixel(one.at_m, one.first_m, one.column) for hand, one in self._seen.items()
        }
        return tips.get("left"), tips.get("right")

    def _command(self) -> int:
        """Return the number of the newest command behind all arms."""
        if len(self._seen) < len(self.hands):
            return NO_COMMAND
        each = [one.command_ns for one in self._seen.values()]
        return min(NO_COMMAND if ns is None else sample_index(ns, self.rate_hz) for ns in each)

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the counters."""
        return [Record(COUNTERS, now_ns, CounterNote(name=name, value=n)) for name, n in self.counters().items()]

    def counters(self) -> dict[str, int]:
        """Return the numbers of frames and of their fragments, and of frames that were missed."""
        return {
            "video_frames": self.n_frames,
            "video_frames_missed": self.ticker.n_missed,
            "video_fragments": self.n_fragments,
        }


def messages(key: str, sight: SightPart, note: CameraNote, data: bytes) -> Iterator[Emission]:
    """Yield the messages that carry a frame; with the last one the frame and ``note`` of it are logged."""
    picture = EncodedFrame(
        frame=note.frame, captured_ns=note.captured_ns, format=sight.codec, data=b64encode(data).decode()
    )
    for index, (payload, said) in enumerate(cut(note.frame, note.captured_ns, data, sight.fragment_bytes)):
        yield _message(key, payload, said, note, picture if index == note.n_fragments - 1 else None)


def _message(key: str, payload: bytes, said: Fragment, note: CameraNote, last_of: EncodedFrame | None) -> Emission:
    seq, content = note.first_seq + said.index, encode(said)

    def on_sent(sent_ns: int) -> list[Record]:
        record = Record(key, sent_ns, content, Fragment, sent_ns, seq)
        if last_of is None:
            return [record]
        whole = replaced(note, sent_ns=sent_ns)
        return [record, Record(CAMERA, note.captured_ns, whole), Record(PICTURES, note.captured_ns, last_of)]

    return Emission("east", key, payload, Header(seq), on_sent)


def build_camera(scenario: Scenario, hands: Sequence[HandChannels]) -> CameraNode:
    """Return the drawn camera of a scenario with sight, which sees the arms that these hands drive."""
    sight = scenario.sight
    assert sight is not None
    n_frames = int(scenario.duration_s * sight.fps + 1e-9)
    scene = scene_of(scenario)
    draw(scene, Stamp(0, NO_COMMAND), [(None, None)])  # what stands still is made now, and not at the first frame
    ticker = Ticker(sight.fps, n_frames, ms_to_ns(sight.camera_phase_ms))
    return CameraNode(scenario.session, hands, sight, scene, scenario.rate_hz, ticker, encoder_of(sight))
