"""The screen: states of frames by what arrives, refreshes, counters."""

from collections.abc import Iterable, Sequence

import numpy as np
from msgspec import convert

from tis.common.messages import Fragment, Header
from tis.common.node import Arrival, Output, Record
from tis.common.records import REJECTED
from tis.common.scenario.sight import SightPart
from tis.common.sight.fragments import Part, cut, parse
from tis.common.sight.picture import Scene, draw
from tis.common.sight.stamp import Picture, Stamp, band_rows
from tis.common.sight_records import SCREEN, ScreenNote
from tis.common.signing import RunKeys
from tis.surgeon_side.screen import ScreenNode

MS = 1_000_000
SIGHT = SightPart(width=320, height=240, fps=10, display_hz=100, display_phase_ms=3, fragment_bytes=100)
SCENE = Scene(320, 240, 150, yields=True)


class Plain:
    """A codec for tests: the number of a picture in 150 bytes. Without the first byte there is no picture."""

    def __init__(self, pictures: Sequence[Picture]) -> None:
        self.pictures, self.is_sound = pictures, True

    def decode(self, stretches: Sequence[tuple[int, bytes]], n_bytes: int) -> Picture | None:
        self.is_sound = bool(stretches) and len(stretches[0][1]) == n_bytes == 150
        return self.pictures[stretches[0][1][0]] if stretches and stretches[0][0] == 0 else None


def _picture(frame: int, command: int = 7) -> Picture:
    return draw(SCENE, Stamp(frame, command), [((100, 100), None)])


def _payloads(frame: int, shown: int | None = None) -> list[bytes]:
    data = bytes([frame if shown is None else shown]) * 150
    return [payload for payload, _ in cut(frame, SIGHT.captured_ns(frame), data, 100)]


def _screen(pictures: Sequence[Picture] = ()) -> ScreenNode:
    return ScreenNode("tis", SIGHT, Plain(pictures or [_picture(k) for k in range(5)]))


def _take(screen: ScreenNode, recv_ns: int, payloads: Iterable[bytes], header: Header | None = None) -> list[Output]:
    attachment = (header or Header(3, recv_ns - MS)).pack()
    found = [screen.receive(Arrival("west", "tis/ECM/video", one, attachment, recv_ns)) for one in payloads]
    return [record for each in found for record in each]


def _notes(records: Iterable[Output]) -> list[ScreenNote]:
    return [one.data for one in records if isinstance(one, Record) and isinstance(one.data, ScreenNote)]


def test_a_frame_is_shown_at_the_refresh_after_its_last_fragment() -> None:
    screen = _screen()
    first, second = _payloads(0)
    (record,) = _take(screen, 40 * MS, [first])
    assert isinstance(record, Record)
    assert isinstance(record.data, bytes)
    assert (record.topic, record.log_ns, record.seq, record.schema) == ("tis/ECM/video", 40 * MS, 3, Fragment)
    assert record.data.startswith(b'{"sample_ns":5000000,"frame":0,"index":0,')
    assert screen.next_wake_ns() is None
    _take(screen, 41 * MS, [second])
    assert screen.next_wake_ns() == 43 * MS
    (record,) = screen.wake(43 * MS)
    assert isinstance(record, Record)
    assert (record.topic, record.log_ns) == (SCREEN, 43 * MS)
    assert record.data == ScreenNote(
        frame=0, state="complete", top_frame=0, top_command=7, bottom_frame=0, bottom_command=7, first_ns=40 * MS,
        last_ns=41 * MS, shown_ns=43 * MS, fragments=2, expected=2,
    )  # fmt: skip
    assert screen.next_wake_ns() is None
    _take(screen, 143 * MS, _payloads(1))
    assert screen.next_wake_ns() == 143 * MS  # a refresh shows what arrives at its instant


def test_of_two_pictures_before_a_refresh_the_newer_one_is_shown() -> None:
    screen = _screen()
    _take(screen, 200 * MS, [*_payloads(0), *_payloads(1)])
    assert [(one.frame, one.shown_ns) for one in _notes(screen.wake(203 * MS))] == [(0, None), (1, 203 * MS)]
    assert np.array_equal(screen.picture if screen.picture is not None else 0, _picture(1))


def test_parts_of_frames_are_concealed_undecodable_or_lost() -> None:
    screen = _screen()
    _take(screen, 400 * MS, [_payloads(0)[0], _payloads(1)[1], *_payloads(3)])
    notes = _notes(screen.wake(403 * MS))
    assert [(one.state, one.fragments, one.expected, one.missing) for one in notes] == [
        ("concealed", 1, 2, "1"), ("undecodable", 1, 2, "0"), ("lost", 0, None, ""), ("complete", 2, 2, ""),
    ]  # fmt: skip
    assert [one.shown_ns for one in notes] == [None, None, None, 403 * MS]
    _take(screen, 410 * MS, [_payloads(4)[0]])
    (last,) = _notes(screen.finish(500 * MS))
    assert (last.frame, last.state, last.shown_ns) == (4, "concealed", None)


def _torn(top: Picture, bottom: Picture) -> Picture:
    picture = top.copy()
    picture[-band_rows(320) :] = bottom[-band_rows(320) :]
    return picture


def test_stamps_that_contradict_each_other_or_the_frame_are_torn() -> None:
    one, other = _picture(0), _picture(1)
    both_of_another, same_frame = other, _torn(one, _picture(0, command=8))
    for picture in (_torn(one, other), _torn(other, one), both_of_another, same_frame):
        screen = _screen([picture])
        _take(screen, 40 * MS, _payloads(0))
        assert [note.state for note in _notes(screen.wake(43 * MS))] == ["torn"]
    swapped = one.copy()
    rows = band_rows(320)
    swapped[:rows], swapped[-rows:] = other[:rows], one[:rows]  # the lower one is an upper stamp
    screen = _screen([swapped])
    _take(screen, 40 * MS, _payloads(0))
    assert [note.state for note in _notes(screen.wake(43 * MS))] == ["torn"]


def test_a_camera_without_stamps_is_shown_without_numbers() -> None:
    screen = _screen([np.zeros((240, 320, 3), dtype=np.uint8)])
    _take(screen, 40 * MS, _payloads(0))
    (note,) = _notes(screen.wake(43 * MS))
    assert (note.state, note.top_frame, note.bottom_command) == ("complete", None, None)


def test_what_is_not_of_the_run_is_refused_and_counted() -> None:
    screen = _screen()
    payload = _payloads(0)[0]
    ahead = _payloads(40)[0]
    records = [
        *_take(screen, 40 * MS, [payload], Header(0, 0, run_id=5)),
        *screen.receive(Arrival("west", "tis/ECM/video", payload, b"x", 40 * MS)),
        *_take(screen, 40 * MS, [payload[:-1], b"", b"x" * 2000]),
        *_take(screen, 40 * MS, [ahead]),
        *_take(screen, 40 * MS, [payload, payload, next(iter(cut(0, 9, b"z" * 150, 100)))[0]]),
    ]
    topics = [one.topic for one in records if isinstance(one, Record)]
    assert topics == [REJECTED] * 6 + ["tis/ECM/video"] * 2 + [REJECTED]
    _take(screen, 200 * MS, _payloads(1))
    _take(screen, 201 * MS, [payload])
    assert screen.counters() == {
        "video_received": 3, "video_duplicated": 1, "video_reordered": 0, "video_corrupted": 3, "video_forged": 4,
        "video_late": 1,
    }  # fmt: skip


def test_the_log_of_a_fragment_is_what_it_says() -> None:
    payload, said = next(iter(cut(4, 5, b"abc", 2)))
    part = parse(payload)
    assert isinstance(part, Part)
    assert part.note() == said
    assert convert(
        {"sample_ns": 5, "frame": 4, "index": 0, "n_fragments": 2, "frame_bytes": 3, "checksum": 0}, Fragment
    )


def test_a_screen_that_comes_back_misses_no_frame_from_before() -> None:
    screen = _screen()
    screen.join(9, 350 * MS)
    _take(screen, 400 * MS, _payloads(4), Header(0, 0, run_id=9))
    assert [(one.frame, one.state) for one in _notes(screen.wake(403 * MS))] == [(4, "complete")]


def test_a_screen_that_comes_back_takes_the_frames_of_a_camera_that_missed_some() -> None:
    screen = _screen()
    screen.join(9, 3050 * MS)  # 30 frames might have been; the camera sends its third
    _take(screen, 3150 * MS, [*_payloads(2), *_payloads(4)], Header(0, 0, run_id=9))
    notes = _notes(screen.wake(3153 * MS))
    assert [(one.frame, one.state) for one in notes] == [(2, "complete"), (3, "lost"), (4, "complete")]


def test_a_screen_of_a_signed_run_uses_what_the_patient_has_signed() -> None:
    screen, payload = _screen(), _payloads(0)
    screen.believe(b"surgeon's key", b"patient's key")
    header = Header(3, 39 * MS).pack()

    def receive(key: bytes, content: bytes) -> None:
        attachment = RunKeys(key).sign("tis/ECM/video", header, content) if key else header
        screen.receive(Arrival("west", "tis/ECM/video", content, attachment, 40 * MS))

    receive(b"", payload[0])
    receive(b"surgeon's key", payload[0])
    receive(b"patient's key", payload[0][:-1])  # damaged on the way, which is no forgery
    counts = screen.counters()
    assert (counts["video_forged"], counts["video_corrupted"], counts["video_received"]) == (2, 1, 0)
    for one in payload:
        receive(b"patient's key", one)
    assert [one.state for one in _notes(screen.wake(43 * MS))] == ["complete"]
    screen.believe(b"surgeon's next key", b"patient's next key")
    receive(b"patient's next key", _payloads(1)[0])
    receive(b"patient's key", _payloads(1)[1])
    assert (screen.counters()["video_received"], screen.counters()["video_forged"]) == (3, 3)


def test_an_external_camera_counts_by_itself_and_may_be_late() -> None:
    """Its stamps need only agree with each other; a frame's number is bounded by its arrival at twice the rate."""
    screen = ScreenNode(
        "tis",
        SightPart(camera="external", fps=10, display_hz=100),
        Plain([_picture(70), _torn(_picture(1), _picture(2))]),
    )
    _take(screen, 200 * MS, [payload for payload, _ in cut(0, 0, bytes(150), 100)])
    _take(screen, 201 * MS, [payload for payload, _ in cut(1, 0, bytes([1]) * 150, 100)])
    notes = _notes(screen.wake(210 * MS))
    assert [(one.state, one.top_frame) for one in notes] == [("complete", 70), ("torn", 1)]
    (early,) = _take(screen, 220 * MS, [payload for payload, _ in cut(26, 0, bytes(50), 100)])
    assert isinstance(early, Record)
    assert early.topic == REJECTED
    (taken,) = _take(screen, 220 * MS, [payload for payload, _ in cut(25, 0, bytes(50), 100)])
    assert isinstance(taken, Record)
    assert taken.topic != REJECTED
