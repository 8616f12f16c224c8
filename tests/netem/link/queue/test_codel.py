from math import isqrt, sqrt

import pytest

from tis.common.scenario.network import capacity
from tis.netem.link.queue.codel import CoDel

MS = 1_000_000
TARGET = 5 * MS
INTERVAL = 100 * MS


def _codel() -> CoDel:
    return CoDel.of(capacity.CoDel(kind="codel"))


def _drops(codel: CoDel, from_ms: int, to_ms: int, waited_ns: int = 50 * MS) -> list[int]:
    """Ask once a ms, as long as the wait stands; return the ms at which a message was dropped."""
    return [ms for ms in range(from_ms, to_ms) if codel.drops(waited_ns, is_short=False, now_ns=ms * MS)]


def test_the_first_drop_comes_after_an_interval_above_the_target() -> None:
    assert _drops(_codel(), 0, 101) == [100]
    assert _drops(_codel(), 7, 108) == [107]


def test_a_wait_of_exactly_the_target_is_too_long_and_less_is_not() -> None:
    assert _drops(_codel(), 0, 101, TARGET) == [100]
    assert _drops(_codel(), 0, 5_000, TARGET - 1) == []


@pytest.mark.parametrize(("waited_ns", "is_short"), [(TARGET - 1, False), (50 * MS, True)])
def test_one_calm_moment_begins_the_interval_anew(waited_ns: int, is_short: bool) -> None:
    codel = _codel()
    assert _drops(codel, 0, 60) == []
    assert not codel.drops(waited_ns, is_short, now_ns=60 * MS)
    assert _drops(codel, 61, 162) == [161]


def test_gaps_follow_the_control_law() -> None:
    due, expected = 100.0, []
    for count in range(1, 9):
        expected.append(due)
        due += 100 / sqrt(count)
    found = _drops(_codel(), 0, int(expected[-1]) + 2)
    # each at the first message whose turn comes at or after the instant that is due
    assert all(0 <= ms - at < 1.001 for ms, at in zip(found, expected, strict=True))
    assert len(found) == 8


def test_several_drops_that_are_due_come_at_once() -> None:
    codel = _codel()
    assert _drops(codel, 0, 101) == [100]
    # due at 200, 270.7, 328.4, 378.4, 423.2: nobody asks before 400
    assert [codel.drops(50 * MS, False, 400 * MS) for _ in range(6)] == [True, True, True, True, False, False]


def test_drops_end_when_the_wait_comes_down() -> None:
    codel = _codel()
    assert _drops(codel, 0, 201) == [100, 200]
    assert not codel.drops(TARGET - 1, False, 201 * MS)
    assert _drops(codel, 202, 302) == []
    assert codel.drops(50 * MS, False, 302 * MS)


@pytest.mark.parametrize(
    ("again_ms", "gap_ns"),
    [
        # 8 drops, the first of them with a count of 1, so 7 were added; the 9th was due at 537.1 ms
        (700, isqrt(INTERVAL**2 // 7)),
        (2_100, isqrt(INTERVAL**2 // 7)),
        (2_300, INTERVAL),  # more than 16 intervals later nothing is remembered
    ],
)
def test_a_count_is_remembered_for_16_intervals(again_ms: int, gap_ns: int) -> None:
    codel = _codel()
    assert len(_drops(codel, 0, 520)) == 8
    assert not codel.drops(0, True, 520 * MS)
    assert not codel.drops(50 * MS, False, (again_ms - 100) * MS)
    assert codel.drops(50 * MS, False, again_ms * MS)
    assert not codel.drops(50 * MS, False, again_ms * MS + gap_ns - 1)
    assert codel.drops(50 * MS, False, again_ms * MS + gap_ns)


def test_a_gap_that_the_dropping_did_not_survive_is_not_counted() -> None:
    """The RFC schedules a drop only while the dropping goes on, which decides how long the count is remembered."""

    def after_three_drops(ends_at_once: bool) -> CoDel:
        codel = _codel()
        assert _drops(codel, 0, 272) == [100, 200, 271]
        if not ends_at_once:
            assert not codel.drops(50 * MS, False, 271 * MS)
        assert not codel.drops(0, True, 271 * MS)
        # the last drop was due at 270.7 ms, the next one at 328.4 ms: 16 intervals later are 1870.7 and 1928.4 ms
        assert not codel.drops(50 * MS, False, 1_800 * MS)
        assert codel.drops(50 * MS, False, 1_900 * MS)
        return codel

    assert not after_three_drops(ends_at_once=True).drops(50 * MS, False, 1_999 * MS)
    assert after_three_drops(ends_at_once=False).drops(50 * MS, False, 1_999 * MS)  # a gap of 100 / sqrt(2)
