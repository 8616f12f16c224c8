"""The camera: frames at their instants, of what arrived by then."""

from base64 import b64decode
from dataclasses import dataclass, field

import pytest

from tis.common.channels import HandChannels, hand_channels
from tis.common.messages import FeedbackPose, Fragment, Header, Quaternion, Vector3, encode
from tis.common.node import Arrival, Emission, Record
from tis.common.scenario.sight import SightPart
from tis.common.sight.codec import Encoded
from tis.common.sight.fragments import Reassembly, parse
from tis.common.sight.picture import Scene
from tis.common.sight.stamp import Picture, Stamp, read_stamps
from tis.common.sight_records import CameraNote, EncodedFrame
from tis.common.signing import RunKeys
from tis.common.ticker import Ticker
from tis.patient_side.camera import CameraNode

MS = 1_000_000
LEFT, RIGHT = hand_channels("left", "PSM2"), hand_channels("right", "PSM1")


@dataclass
class Kept:
    """Keeps the pictures; a frame has 250 bytes."""

    pictures: list[Picture] = field(default_factory=list)

    def encode(self, picture: Picture) -> Encoded:
        self.pictures.append(picture)
        return Encoded(bytes([len(self.pictures)]) * 250, is_key=True)


def _camera(*hands: HandChannels) -> CameraNode:
    sight = SightPart(fps=20, fragment_bytes=100, width=320, height=240)
    return CameraNode("tis", hands or (LEFT,), sight, Scene(320, 240, 150, True), 100, Ticker(20, 10, 5 * MS), Kept())


def _pose(
    camera: CameraNode, tick: int, x_m: float, command_ns: int | None, hand: HandChannels = LEFT, key: bytes = b""
) -> None:
    place = Vector3(x=x_m, y=0.0, z=0.0)
    turn = Quaternion(x=0.0, y=0.0, z=0.0, w=1.0)
    pose = FeedbackPose(
        sample_ns=tick * 10 * MS, position_m=place, orientation=turn, gripper_rad=0.0, tick=tick,
        command_sample_ns=command_ns,
    )  # fmt: skip
    name, payload, attachment = hand.measured.key("tis"), encode(pose), Header(tick).pack()
    if key:
        attachment = RunKeys(key).sign(name, attachment, payload)
    assert camera.receive(Arrival("east", name, payload, attachment, tick * 10 * MS)) == ()


def _frame(camera: CameraNode, now_ns: int) -> tuple[list[Emission], CameraNote, EncodedFrame]:
    emissions = [one for one in camera.wake(now_ns) if isinstance(one, Emission)]
    records: list[Record] = []
    for i, emission in enumerate(emissions):
        records += emission.on_sent(now_ns + i)
    *messages, note, picture = (record.data for record in records)
    assert len(messages) == len(emissions)
    assert isinstance(note, CameraNote)
    assert isinstance(picture, EncodedFrame)
    return emissions, note, picture


def test_a_frame_shows_what_arrived_by_its_instant_and_is_sent_in_fragments() -> None:
    camera = _camera()
    assert camera.next_wake_ns() == 5 * MS
    _, note, _ = _frame(camera, 5 * MS)
    assert (note.command, note.left_x, note.right_x) == (-1, None, None)
    _pose(camera, 1, 0.0, None)
    _pose(camera, 3, 0.01, 20 * MS)
    _pose(camera, 2, 9.0, 10 * MS)  # an older one that was overtaken
    emissions, note, picture = _frame(camera, 56 * MS)
    assert [(one.network, one.key, one.attachment) for one in emissions] == [
        ("east", "tis/ECM/video", Header(seq)) for seq in (3, 4, 5)
    ]
    assert note == CameraNote(
        frame=1, captured_ns=55 * MS, command=2, left_x=200, left_y=96, right_x=None, right_y=None, is_key=True,
        n_bytes=250, n_fragments=3, first_seq=3, sent_ns=56 * MS + 2,
    )  # fmt: skip
    assert b64decode(picture.data) == bytes([2]) * 250
    assert (picture.frame, picture.captured_ns, picture.format) == (1, 55 * MS, "jpeg")
    assert isinstance(camera.encoder, Kept)
    assert read_stamps(camera.encoder.pictures[1]) == (Stamp(1, 2),) * 2
    frames = Reassembly(next_frame=1)
    for emission in emissions:
        part = parse(emission.payload)
        assert part is not None
        frames.take(part, 0)
        (record,) = emission.on_sent(0)[:1]
        assert (record.topic, record.schema, record.data) == ("tis/ECM/video", Fragment, encode(part.note()))
    _, found = frames.pop()
    assert found is not None
    assert found.stretches() == [(0, bytes([2]) * 250)]


def test_a_frame_that_is_missed_is_not_sent_and_has_no_number() -> None:
    camera = _camera()
    _, note, _ = _frame(camera, 160 * MS)
    assert (note.frame, note.captured_ns) == (0, 155 * MS)
    assert camera.counters() == {"video_frames": 1, "video_frames_missed": 3, "video_fragments": 3}
    assert list(camera.wake(2000 * MS)) == []
    assert camera.next_wake_ns() is None


def test_two_arms_show_the_older_command() -> None:
    camera = _camera(LEFT, RIGHT)
    _pose(camera, 1, 0.0, 10 * MS)
    assert _frame(camera, 5 * MS)[1].command == -1
    _pose(camera, 1, 0.0, 0, RIGHT)
    note = _frame(camera, 55 * MS)[1]
    assert (note.command, note.left_x, note.right_x) == (0, 80, 240)


def test_a_camera_that_comes_back_has_new_numbers() -> None:
    camera = _camera()
    camera.join(0, 200 * MS)
    emissions, note, _ = _frame(camera, 205 * MS)
    assert (note.frame, note.first_seq) == (4, 50_000)
    assert len(emissions) == 3


@pytest.mark.parametrize("what", [b"", b"x" * 40])
def test_what_is_no_pose_is_not_seen(what: bytes) -> None:
    camera = _camera()
    assert camera.receive(Arrival("east", LEFT.measured.key("tis"), what, Header(0).pack(), 0)) == ()
    assert _frame(camera, 5 * MS)[1].left_x is None


def test_a_camera_of_a_signed_run_sees_what_its_own_side_has_signed() -> None:
    camera = _camera()
    camera.believe(b"patient's key", b"surgeon's key")
    _pose(camera, 1, 0.0, 0)
    assert _frame(camera, 5 * MS)[1].left_x is None
    _pose(camera, 1, 0.0, 0, key=b"patient's key")
    assert _frame(camera, 55 * MS)[1].left_x == 160
