"""The answer of a comparison against reports written by hand."""

from collections.abc import Mapping
from typing import Any

import pytest

from tis.deploy.compare.results.answer import answer

Ratios = Mapping[str, tuple[float, float, float | None]]
"""By estimator: ratio to hold, ratio to the best, and the lower end of that ratio's interval."""


def report(settings: Mapping[str | None, Ratios], n_people: int = 6) -> dict[str, Any]:
    rows = [
        {
            "setting": setting, "estimator": name, "rmse_3d_mm": 2 * ratio, "ratio_to_hold": ratio,
            "ratio_to_best": to_best, "ratio_to_best_interval_95": None if low is None else [low, low + 0.5],
            "n_people": n_people,
        }
        for setting, ratios in settings.items()
        for name, (ratio, to_best, low) in ratios.items()
    ]  # fmt: skip
    abouts = [{"setting": one, "n_cells": 1, "at": {} if one is None else {"a.delay_ms": one}} for one in settings]
    return {"rows": rows, "settings": abouts, "trials": ["one"] * n_people}


FAR: Ratios = {"hold": (1.0, 2.0, 1.8), "one": (0.5, 1.0, 1.0), "two": (0.8, 1.6, 1.3)}
NEAR: Ratios = {"hold": (1.0, 1.25, 1.1), "one": (0.8, 1.0, 1.0), "two": (0.82, 1.025, 0.99)}
WORSE: Ratios = {"hold": (1.0, 1.0, 1.0), "one": (1.2, 1.2, 1.1), "two": (1.3, 1.3, 1.1)}


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({None: FAR}, "one is best: its error is 50 % below hold's. It is told apart from each other one."),
        (
            {"100": FAR, "300": NEAR},
            "one is best at each of the 2 settings: its error is 20 to 50 % below hold's. two is not told apart from "
            "one at delay_ms = 300.",
        ),
        (
            {"100": FAR, "300": FAR, "600": WORSE},
            "one is best at delay_ms = 100; at delay_ms = 300: its error is 50 % below hold's. No estimator is "
            "better than hold at delay_ms = 600. Each is told apart from all others.",
        ),
    ],
)
def test_the_best_is_named_with_its_gain_and_its_rivals(settings: Mapping[str | None, Ratios], words: str) -> None:
    assert answer(report(settings)) == words


def test_a_cover_far_below_95_is_told() -> None:
    found = report({"100": FAR, "300": FAR})
    for row, cover in zip(found["rows"], (None, 94.0, 2.5, None, 81.0, 40.0), strict=True):
        row["coverage_pct"] = cover
    assert answer(found).endswith(
        "two is overconfident: its 95 % ellipsoids hold 2.50 % of its errors at the worst setting."
    )
    assert "one is overconfident" not in answer(found)
    covers = {"coverage_pct": 71.0, "gripper_coverage_pct": 93.0}
    found["orientation"] = [{"setting": "100", "method": "tangent_ls", **covers}]
    said = "its 95 % regions hold 71.00 % of its errors of orientation at the worst setting."
    assert answer(found).endswith(f"tangent_ls is overconfident: {said}")


def test_no_gain_is_all_of_the_error() -> None:
    tiny: Ratios = {"hold": (1.0, 800.0, 700.0), "one": (0.00125, 1.0, 1.0)}
    assert answer(report({None: tiny})).startswith("one is best: its error is 99.9 % below hold's.")


@pytest.mark.parametrize("n_people", [2, 5])
def test_of_few_people_nothing_is_told_apart(n_people: int) -> None:
    found = answer(report({"100": FAR, "300": NEAR}, n_people))
    assert f"With {n_people} people no estimator is told apart" in found
    assert "that takes 6" in found
    assert "two is" not in found
    assert "Each is" not in found


def test_of_one_recording_nothing_is_claimed_about_others() -> None:
    alone = {name: (ratio, best, None) for name, (ratio, best, _) in FAR.items()}
    found = answer(report({None: alone}, n_people=1))
    assert found.endswith("This holds for this recording alone: nothing can be claimed about others.")
    assert "told apart" not in found


def test_without_a_scored_row_there_is_no_answer() -> None:
    found = report({None: FAR})
    for row in found["rows"]:
        row["rmse_3d_mm"] = None
    assert answer(found) == ""
