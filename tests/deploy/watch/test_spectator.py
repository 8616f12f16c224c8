"""What a program that only listens is told of the picture: the newest one, its instant, the share that is whole."""

import numpy as np

from tests.surgeon_side.test_screen import MS, SIGHT, Plain, _payloads, _picture
from tis.common.messages import Header
from tis.deploy.watch.spectator import Spectator

_AHEAD_NS = 900_000 * MS
"""The run's clock less the spectator's."""


def _spectator() -> Spectator:
    return Spectator("tis", SIGHT, lambda _: Plain([_picture(k) for k in range(60)]))


def _take(spectator: Spectator, frame: int, parts: slice = slice(None), run_id: int = 3, seq: int = 0) -> None:
    at_ns = SIGHT.captured_ns(frame) + 40 * MS - _AHEAD_NS
    for payload in _payloads(frame)[parts]:
        spectator.take(payload, Header(seq, 1, run_id).pack(), at_ns)


def test_it_begins_in_the_middle_of_a_run_and_shows_each_picture_at_once() -> None:
    spectator = _spectator()
    _take(spectator, 41, slice(1))
    assert spectator.shown is None
    _take(spectator, 41, slice(1, None))
    shown = spectator.shown
    assert shown is not None
    assert (shown.number, shown.frame, shown.state, shown.captured_ns) == (1, 41, "complete", 4105 * MS)
    assert np.array_equal(shown.picture, _picture(41))
    _take(spectator, 42)
    assert spectator.shown is not None
    assert (spectator.shown.number, spectator.shown.frame) == (2, 42)


def test_the_share_that_came_whole_is_that_of_the_last_seconds() -> None:
    spectator = _spectator()
    for frame in range(50):
        _take(spectator, frame, slice(0, 1) if frame in (5, 40) else slice(None))
    assert spectator.shown is not None
    assert (spectator.shown.n_whole, spectator.shown.n) == (19, 20)  # 2 s at 10 frames per second; 5 is long ago


def test_a_new_run_begins_anew_and_what_is_not_of_the_picture_changes_nothing() -> None:
    spectator = _spectator()
    _take(spectator, 30)
    _take(spectator, 2, run_id=4)
    assert spectator.shown is not None
    assert (spectator.shown.number, spectator.shown.frame, spectator.shown.n) == (2, 2, 1)
    before = spectator.shown
    spectator.take(b"no fragment", Header(0).pack(), 0)
    spectator.take(_payloads(3)[0], b"foreign", 0)
    for payload in _payloads(55):  # 5 s ahead of its clock: refused, whatever it claims to be
        spectator.take(payload, Header(0, 1, 4).pack(), SIGHT.captured_ns(3) + 40 * MS - _AHEAD_NS)
    assert spectator.shown is before


def test_it_begins_anew_where_it_could_not_keep_up() -> None:
    spectator = _spectator()
    _take(spectator, 1)
    spectator.restart()
    _take(spectator, 9)
    assert spectator.shown is not None
    assert (spectator.shown.frame, spectator.shown.n, spectator.shown.n_whole) == (9, 1, 1)


def test_a_camera_of_others_has_stamps_once_one_was_read() -> None:
    plain = np.zeros((240, 320, 3), dtype=np.uint8)
    pictures = [plain, plain, _picture(2), plain]
    external = SIGHT.model_copy(update={"camera": "external"})
    for sight, expected in ((SIGHT, [True] * 4), (external, [False, False, True, True])):
        spectator, found = Spectator("tis", sight, lambda _: Plain(pictures)), []
        for frame in range(4):
            _take(spectator, frame)
            assert spectator.shown is not None
            found.append(spectator.shown.is_stamped)
        assert found == expected
