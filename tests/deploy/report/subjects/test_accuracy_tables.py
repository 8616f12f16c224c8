"""The table of estimators: bars that can be told apart whoever is beside them, and no columns of dashes."""

import re
from typing import Any

import pytest

from tests.deploy.report.partial import part
from tis.deploy.report.subjects.accuracy import Scores, accuracy_table, slow_estimators

_WIDTH = re.compile(r"width:([\d.]+)%")


def _entry(rmse_mm: float, step_us: float | None = None) -> Any:
    values = {
        "rmse_3d_mm": rmse_mm,
        "ratio_to_hold": rmse_mm / 2.0,
        "r2_pct": [1.0, 2.0, 3.0],
        "n_scored": 9,
        "n_missing": 0,
        "step_us": {"p50": step_us, "p99": step_us},
    }
    return part(Scores, values)


def test_one_that_errs_by_far_more_leaves_the_other_bars_readable_and_is_marked() -> None:
    """hold errs by 2 mm: bars end at 6 mm."""
    scores = {"hold": _entry(2.0), "innovations_kf": _entry(0.6), "paper": _entry(54.1)}
    page = accuracy_table(scores, "left hand", "innovations_kf").html()
    assert [float(width) for width in _WIDTH.findall(page)] == [33.3, 10.0, 100.0]
    assert "\u00bb 54.10" in page
    assert page.count("\u00bb") == 2  # there, and in the note
    assert "Bars end at 3 times hold's error; longer ones are cut" in page


def test_where_all_are_alike_the_largest_error_is_the_whole_bar() -> None:
    page = accuracy_table({"hold": _entry(2.0), "velocity": _entry(4.0)}, "left hand", "hold").html()
    assert [float(width) for width in _WIDTH.findall(page)] == [50.0, 100.0]
    assert "cut" not in page
    alone = accuracy_table({"velocity": _entry(4.0)}, "left hand", "velocity").html()
    assert [float(width) for width in _WIDTH.findall(alone)] == [100.0]


def test_the_time_of_a_step_has_a_column_where_it_was_measured() -> None:
    assert "step" not in accuracy_table({"hold": _entry(2.0)}, "left hand", "hold").html()
    assert (
        "step, median"
        in accuracy_table({"hold": _entry(2.0), "plant": _entry(1.0, 41.0)}, "left hand", "hold").html()
    )


@pytest.mark.parametrize(
    ("steps_us", "n_hands", "rate_hz", "told"),
    [
        ({"hold": (3, 9), "mine:Slow": (30_400, 31_000)}, 1, 50,
         "as mine:Slow takes 30.40 ms a step at the median, and a tick lasts 20.00 ms"),
        ({"one": (600, 700), "other": (800, 900)}, 1, 1000,
         "as other takes 0.800 ms a step, of 1.40 ms of all, at the median, and a tick lasts 1.00 ms"),
        ({"one": (9000, 9100)}, 2, 60, "as one takes 18.00 ms a step at the median, and a tick lasts 16.67 ms"),
        ({"hold": (3, 9), "mine:Lazy": (90, 45_000)}, 1, 50,
         "as mine:Lazy takes 45.00 ms a step at one in a hundred, and a tick lasts 20.00 ms"),
        ({"hold": (3, 30_000), "mine:Fast": (90, 45_000)}, 1, 50, ""),  # a busy machine slows all
        ({"hold": (3, 9), "moesp_kf": (90, 400)}, 2, 1000, ""),
        ({"hold": (None, None)}, 1, 30, ""),  # virtual time
        ({}, 1, 30, ""),
    ],
)  # fmt: skip
def test_estimators_that_are_slower_than_a_tick_are_named(
    steps_us: dict[str, tuple[float, float]], n_hands: int, rate_hz: int, told: str
) -> None:
    scores = {name: Scores.model_construct(step_us={"p50": p50, "p99": p99}) for name, (p50, p99) in steps_us.items()}
    assert slow_estimators(scores, n_hands, rate_hz) == told
