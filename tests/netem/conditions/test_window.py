from dataclasses import replace
from typing import Any

import pytest
from pydantic import ValidationError

from tis.common.scenario.network.conditions import TimelineEntry
from tis.netem.conditions.timeline import Window
from tis.netem.draws.grid import LAST_CELL


def _entry(at_s: float, for_s: float | None = None, **more: Any) -> TimelineEntry:
    raw = {"at_s": at_s, "for_s": for_s, "set": {"add_delay_ms": 10}, **more}
    return TimelineEntry.model_validate(raw)


@pytest.mark.parametrize(
    ("at_s", "for_s", "begin", "end"),
    [
        (0.0, 0.001, 0, 1),
        (0.0014, 0.002, 1, 3),  # 1.4 .. 3.4 ms
        (0.0015, 0.002, 2, 4),  # 1.5 .. 3.5 ms
        (0.0052, 0.0001, 5, 6),  # shorter than a cell: one cell
        (0.1, 0.2, 100, 300),  # 0.1 + 0.2 is not 0.3 in binary
        (4.0, None, 4000, LAST_CELL),
    ],
)
def test_an_entry_moves_to_the_nearest_cells(at_s: float, for_s: float | None, begin: int, end: int) -> None:
    window = Window.of(_entry(at_s, for_s))
    assert (window.begin, window.stop) == (begin, end)


def test_a_ramp_grows_and_shrinks_by_equal_steps() -> None:
    window = Window.of(_entry(0.1, 0.02, ramp_s=0.005))
    strengths = [window.strength(cell) for cell in range(100, 120)]
    assert strengths == [0, 0.2, 0.4, 0.6, 0.8, *[1.0] * 11, 0.8, 0.6, 0.4, 0.2]
    endless = Window.of(_entry(0.1, ramp_s=0.005))
    assert [endless.strength(cell) for cell in (100, 102, 105, 10**9)] == [0, 0.4, 1, 1]


def test_a_ramp_is_at_most_half_as_long_as_its_window() -> None:
    window = Window.of(_entry(0.1, 0.003, ramp_s=0.0015))  # 1.5 ms would go to 2 of 3 cells
    assert (window.begin, window.stop, window.ramp) == (100, 103, 1)
    with pytest.raises(ValidationError, match="at most half"):
        _entry(0.1, 0.003, ramp_s=0.002)


def test_one_that_comes_late_holds_as_long_as_it_says() -> None:
    late = Window.of(_entry(1, 0.5, ramp_s=0.1), earliest=1600)
    assert (late.begin, late.end, late.strength(1650), late.strength(2050)) == (1600, 2100, 0.5, 0.5)
    assert Window.of(_entry(1, 0.5), earliest=900).begin == 1000
    assert Window.of(_entry(1), earliest=1600).end == LAST_CELL


def test_cut_short_its_ramps_stay_where_they_are() -> None:
    window = Window.of(_entry(1, 0.5, ramp_s=0.1), earliest=0)
    cut = replace(window, cut=1450)
    assert (window.edges, cut.edges) == ([1000, 1500, 1100, 1401], [1000, 1450, 1100, 1401])
    assert [cell for cell in (999, 1000, 1099, 1100, 1400, 1401, 1449) if cut.moves_in(cell) and cell >= 1000] == [
        1000, 1099, 1401, 1449,
    ]  # fmt: skip
    assert cut.strength(1449) == window.strength(1449) == pytest.approx(0.51)
