"""A camera of others: each message is a frame that is sent in fragments, with literal instants; junk is counted."""

import json
from base64 import b64encode
from typing import Any

import pytest

from tis.common.messages import Header
from tis.common.node import Arrival, Emission, Record
from tis.common.scenario.sight import SightPart
from tis.common.sight.fragments import parse
from tis.common.sight_records import CameraNote, EncodedFrame
from tis.patient_side.external_camera import ExternalCamera

MS = 1_000_000
BEGIN_NS = 1_700_000_000_500_000_000
"""The run's begin since 1970."""


def _camera(codec: str = "jpeg", **fields: Any) -> ExternalCamera:
    sight = SightPart.model_validate(
        {"camera": "external", "fps": 10, "fragment_bytes": 100, "codec": codec} | fields
    )
    camera = ExternalCamera("tis", sight, 20_000 * MS)
    camera.join(7, 0, BEGIN_NS)
    return camera


def _message(data: bytes = b"x" * 250, at_ns: int | None = None, **changed: Any) -> bytes:
    frame = {"data": b64encode(data).decode(), "format": "jpeg", "frame_id": "camera"}
    if at_ns is not None:
        since_1970_ns = BEGIN_NS + at_ns
        frame |= {"timestamp": {"sec": since_1970_ns // 10**9, "nsec": since_1970_ns % 10**9}}  # type: ignore[dict-item]
    return json.dumps(frame | changed).encode()


def _take(camera: ExternalCamera, recv_ns: int, payload: bytes) -> list[Emission]:
    outputs = [*camera.receive(Arrival("east", "tis/ECM/camera", payload, b"", recv_ns))]
    emissions = [one for one in outputs if isinstance(one, Emission)]
    assert len(emissions) == len(outputs)
    return emissions


def _note(emissions: list[Emission]) -> CameraNote:
    record = emissions[-1].on_sent(99 * MS)[1]
    assert isinstance(record.data, CameraNote)
    return record.data


def test_a_frame_is_sent_in_fragments_with_consecutive_numbers() -> None:
    camera = _camera()
    assert camera.listens() == [("east", "tis/ECM/camera")]
    assert camera.next_wake_ns() is None
    first = _take(camera, 50 * MS, _message(at_ns=20 * MS))
    second = _take(camera, 150 * MS, _message(at_ns=120 * MS))
    assert [(one.network, one.key, one.attachment) for one in first + second] == [
        ("east", "tis/ECM/video", Header(seq)) for seq in range(6)
    ]
    parts = [parse(one.payload) for one in second]
    assert b"".join(one.content for one in parts if one) == b"x" * 250
    assert {(one.frame, one.captured_ns, one.n_fragments) for one in parts if one} == {(1, 120 * MS, 3)}
    assert [len(one.on_sent(99 * MS)) for one in second] == [1, 1, 3]
    _, note, picture = (record.data for record in second[-1].on_sent(99 * MS))
    assert note == CameraNote(
        frame=1, captured_ns=120 * MS, command=-1, left_x=None, left_y=None, right_x=None, right_y=None, is_key=True,
        n_bytes=250, n_fragments=3, first_seq=3, sent_ns=99 * MS,
    )  # fmt: skip
    assert isinstance(picture, EncodedFrame)
    assert (picture.frame, picture.format) == (1, "jpeg")
    assert camera.counters()["camera_undated"] == 0


@pytest.mark.parametrize("at_ns", [None, -1, 51 * MS, 10**17])
def test_a_frame_without_a_timestamp_that_can_be_true_was_captured_when_it_came(at_ns: int | None) -> None:
    camera = _camera()
    assert _note(_take(camera, 50 * MS, _message(at_ns=at_ns))).captured_ns == 50 * MS
    assert camera.counters()["camera_undated"] == 1


def test_a_capture_of_more_than_ten_seconds_ago_is_not_believed() -> None:
    camera = _camera()
    assert _note(_take(camera, 15_000 * MS, _message(at_ns=4_999 * MS))).captured_ns == 15_000 * MS
    assert _note(_take(camera, 15_000 * MS, _message(at_ns=5_000 * MS))).captured_ns == 5_000 * MS


@pytest.mark.parametrize(
    ("payload", "reason"),
    [
        (b"", "undecodable"), (b"\xff\xd8 a bare jpeg", "undecodable"), (b"[" * 100_000, "undecodable"),
        (b'{"data": "no base64!", "format": "jpeg"}', "undecodable"),
        (_message(data=b""), "undecodable"), (_message(timestamp="now"), "undecodable"),
        (_message(position_m=1), "undecodable"), (_message(timestamp={"sec": -1, "nsec": 0}), "undecodable"),
        (_message(timestamp={"sec": 1, "nsec": 10**9}), "undecodable"),
        (_message(format="h264"), "other_format"), (_message(format="png"), "other_format"),
    ],
)  # fmt: skip
def test_what_is_no_frame_is_counted(payload: bytes, reason: str) -> None:
    camera = _camera()
    assert _take(camera, 50 * MS, payload) == []
    counters = camera.counters()
    assert {name: n for name, n in counters.items() if n} == {f"camera_{reason}": 1}


def test_after_the_last_sample_nothing_is_sent_or_counted() -> None:
    camera = _camera()
    assert _take(camera, 20_000 * MS, _message()) == _take(camera, 20_001 * MS, b"") == []
    assert not any(camera.counters().values())


def test_of_a_flood_twice_the_rate_is_sent() -> None:
    camera = _camera()
    for k in range(1001):  # a second at 1 kHz
        _take(camera, k * MS, _message())
    assert camera.counters()["video_frames"] == 22  # 20 a second, that at 0 and one ahead
    assert camera.counters()["camera_flooded"] == 1001 - 22


def test_key_frames_of_h264_are_known_by_their_units() -> None:
    camera = _camera("h264")
    key, other = b"\0\0\0\1\x67ab\0\0\1\x65cd", b"\0\0\1\x41ef"
    notes = [_note(_take(camera, 50 * MS, _message(data, format="h264"))) for data in (key, other)]
    assert [one.is_key for one in notes] == [True, False]


def test_a_camera_that_comes_back_has_new_numbers() -> None:
    camera = _camera()
    camera.join(7, 2000 * MS, BEGIN_NS)
    (first, *_) = _take(camera, 2100 * MS, _message())
    part = parse(first.payload)
    assert part is not None
    assert part.frame > camera.sight.last_frame(1999 * MS)
    assert first.attachment == Header(2000 * MS // 4000)


def test_the_counters_are_logged_at_the_end() -> None:
    records = _camera().finish(5 * MS)
    assert all(isinstance(one, Record) for one in records)
    assert len(records) == 6
