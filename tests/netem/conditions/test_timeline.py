from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.channels import Direction
from tis.common.errors import InputError
from tis.common.scenario.network.conditions import TimelineEntry
from tis.netem.conditions.timeline import MAX_ADDED, Timeline
from tis.netem.draws.grid import LAST_CELL

SET = {"scale_delay": 3.0, "add_delay_ms": 10.0}


def _entry(at_s: float, for_s: float | None = None, set_: dict[str, Any] = SET, **more: Any) -> TimelineEntry:
    return TimelineEntry.model_validate({"at_s": at_s, "for_s": for_s, "set": set_, **more})


def test_only_what_is_ramped_moves() -> None:
    stepped = Timeline([_entry(0.1, 0.02, {"outage": True}, ramp_s=0.005)], "forward")
    assert [(stepped.at(cell).end, stepped.at(cell).moves) for cell in (0, 100, 120)] == [
        (100, False), (120, False), (LAST_CELL, False),
    ]  # fmt: skip
    ramped = Timeline([_entry(0.1, 0.02, ramp_s=0.005)], "forward")
    assert [cell for cell in range(130) if ramped.at(cell).moves] == [100, 101, 102, 103, 104, 116, 117, 118, 119]
    assert ramped.at(105)[:2] == (105, 116)


def test_each_direction_has_its_own() -> None:
    entries = [_entry(1, 1, direction="forward"), _entry(4, 1, direction="feedback"), _entry(7, 1)]

    def holding(direction: Direction) -> list[int]:
        timeline = Timeline(entries, direction)
        return [s for s in range(10) if not timeline.at(s * 1000).is_empty]

    assert holding("forward") == [1, 7]
    assert holding("feedback") == [4, 7]
    assert Timeline([entries[1]], "forward").is_empty


Spec = tuple[int, int | None, int]
ENTRIES = st.lists(st.tuples(st.integers(0, 60), st.none() | st.integers(1, 30), st.integers(0, 8)), max_size=6)


def _expected(spec: Spec, cell: int) -> float | None:
    """Return the strength of an entry by its definition; None: it does not hold."""
    begin, length, ramp = spec
    if cell < begin or (length is not None and cell >= begin + length):
        return None
    parts = [1.0]
    if ramp:
        parts.append((cell - begin) / ramp)
        if length is not None:
            parts.append((begin + length - cell) / ramp)
    return min(parts)


@settings(deadline=None, max_examples=100)
@given(ENTRIES, st.permutations(range(100)))
def test_agrees_with_each_entry_by_itself(specs: list[Spec], order: list[int]) -> None:
    specs = [(begin, n, ramp if n is None else min(ramp, n // 2)) for begin, n, ramp in specs]
    entries = [
        _entry(begin / 1000, None if n is None else n / 1000, {"add_delay_ms": i + 1.0}, ramp_s=ramp / 1000)
        for i, (begin, n, ramp) in enumerate(specs)
    ]
    timeline = Timeline(entries, "forward")

    def expected(cell: int) -> list[tuple[float, float]]:
        strengths = [(i + 1.0, _expected(spec, cell)) for i, spec in enumerate(specs)]
        return [(added_ms, strength) for added_ms, strength in strengths if strength is not None]

    for cell in order:
        segment = timeline.at(cell)
        found = [(window.change.add_delay_ms, window.strength(cell)) for window in segment.modulating]
        assert found == expected(cell)
        assert segment.begin <= cell < segment.end
        if not segment.moves:
            assert all(expected(other) == found for other in range(segment.begin, min(100, segment.end)))


def test_what_is_added_late_holds_as_long_as_it_says() -> None:
    timeline = Timeline([], "forward")
    assert timeline.add(_entry(1, 0.5), earliest=2001) == 2001
    assert timeline.add(_entry(3, 0.5), earliest=2001) == 3000
    assert [timeline.at(cell).is_empty for cell in (2000, 2001, 2500, 2501, 2999, 3000, 3499, 3500)] == [
        True, False, False, True, True, False, False, True,
    ]  # fmt: skip


def test_clearing_ends_ramps_at_once_and_leaves_what_was_written() -> None:
    timeline = Timeline([_entry(0, 10)], "forward")
    timeline.add(_entry(1, 1, {"add_delay_ms": 1}, ramp_s=0.5), earliest=1)
    timeline.add(_entry(5, 1, {"add_delay_ms": 1}), earliest=1)
    before = [timeline.at(cell) for cell in range(1600)]
    timeline.clear_added(1600)
    assert [timeline.at(cell).modulating[1:] for cell in (1600, 1999, 5500)] == [(), (), ()]
    for cell in range(1600):
        ours, theirs = timeline.at(cell), before[cell]
        assert (ours.begin, ours.moves) == (theirs.begin, theirs.moves)
        assert [w.strength(cell) for w in ours.modulating] == [w.strength(cell) for w in theirs.modulating]
    assert not timeline.at(0).is_empty


def test_what_was_added_is_listed_from_when_it_holds() -> None:
    timeline = Timeline([_entry(0, 10)], "forward")
    timeline.add(_entry(1, 0.5), earliest=2001)
    timeline.add(_entry(3), earliest=2001)
    timeline.add(_entry(3, direction="feedback"), earliest=2001)
    assert timeline.added(2001) == (_entry(2.001, 0.5), _entry(3))
    assert timeline.added(2501) == (_entry(3),)
    timeline.clear_added(2600)
    assert timeline.added(2600) == ()


def test_additions_are_bounded() -> None:
    timeline = Timeline([], "forward")
    for i in range(MAX_ADDED - 1):
        timeline.add(_entry(1 + i, 0.1), earliest=1)
    timeline.add(_entry(0), earliest=1)
    with pytest.raises(InputError, match=f"control: must come while fewer than {MAX_ADDED}"):
        timeline.add(_entry(0), earliest=1)
    timeline.add(_entry(0, direction="feedback"), earliest=1)
    timeline.add(_entry(100, 0.1), earliest=2000)  # one is over by now
    assert len(timeline.at(100_050).modulating) == 3
    timeline.clear_added(3000)
    timeline.add(_entry(0), earliest=3000)
    assert len(timeline.at(3000).modulating) == 1
