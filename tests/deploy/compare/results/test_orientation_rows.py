from typing import Any

import numpy as np
import pytest

from tis.deploy.compare.cells.sums import histogram
from tis.deploy.compare.results.orientation_rows import orientation_rows
from tis.deploy.compare.results.pooled import resampled
from tis.deploy.compare.results.tables import turn_ratio_table, turn_table


def hand(n: int, held_deg: float, other_deg: float, covered: int) -> dict[str, Any]:
    """The sums of a hand whose errors all have one size."""

    def sums(degrees: float, n_covered: int, n_stated: int) -> dict[str, Any]:
        square = n * np.radians(degrees) ** 2
        return {
            "sse_rad2": float(square), "sse_gripper_rad2": n * (degrees / 100) ** 2, "n_scored": n, "n_missing": 1,
            "n_gripper_scored": n,
            "n_covered": n_covered, "n_ellipsoids": n_stated, "n_gripper_covered": 0, "n_gripper_intervals": 0,
            "step_ns": histogram(np.array([1000, 2000, 3000])),
        }  # fmt: skip

    return {"orientation": {"tangent_ls": sums(other_deg, covered, n), "hold": sums(held_deg, 0, 0)}}


PEOPLE = [[hand(100, 4.0, 2.0, 95)], [hand(50, 8.0, 6.0, 40), hand(50, 2.0, 1.0, 50)], [hand(200, 3.0, 1.0, 190)]]


def test_ratios_are_those_of_all_ticks_together_and_hold_stands_first() -> None:
    hold, row = orientation_rows({"setting": "33"}, PEOPLE)
    assert (hold["method"], row["method"], row["setting"]) == ("hold", "tangent_ls", "33")
    held = (100 * 16 + 50 * 64 + 50 * 4 + 200 * 9) / 400
    other = (100 * 4 + 50 * 36 + 50 * 1 + 200 * 1) / 400
    assert hold["rms_deg"] == pytest.approx(held**0.5)
    assert row["rms_deg"] == pytest.approx(other**0.5)
    assert row["ratio_to_hold"] == pytest.approx((other / held) ** 0.5)
    assert row["gripper_rms_rad"] == pytest.approx(other**0.5 / 100)
    assert row["coverage_pct"] == pytest.approx(100 * 375 / 400)
    assert hold["coverage_pct"] is None
    assert row["n_scored"] == 400
    assert row["step_us"]["p50"] == pytest.approx(2.0, rel=1e-3)


def test_intervals_are_those_of_a_loop_over_resamples_of_people() -> None:
    row = orientation_rows({"setting": None}, PEOPLE)[1]
    ratios = []
    for chosen in resampled(3).tolist():
        entries = [each["orientation"] for place in chosen for each in PEOPLE[place]]
        squares = [sum(entry[name]["sse_rad2"] for entry in entries) for name in ("tangent_ls", "hold")]
        ratios.append((squares[0] / squares[1]) ** 0.5)
    assert row["ratio_to_hold_interval_95"] == pytest.approx(np.percentile(ratios, [2.5, 97.5]).tolist())
    (alone,) = (each for each in orientation_rows({"setting": None}, PEOPLE[:1]) if each["method"] == "tangent_ls")
    assert alone["ratio_to_hold_interval_95"] is None


def test_a_method_that_one_hand_lacks_has_no_row() -> None:
    (one,) = (dict(each) for each in PEOPLE[0])
    one["orientation"] = {"hold": one["orientation"]["hold"]}
    assert [row["method"] for row in orientation_rows({}, [[one], *PEOPLE[1:]])] == ["hold"]
    assert orientation_rows({}, []) == []


def test_tables_show_degrees_and_ratios() -> None:
    rows = [row for setting in ("33", "200") for row in orientation_rows({"setting": setting}, PEOPLE)]
    hold, other, *_ = turn_table(rows).texts()
    assert other[:3] == ["tangent_ls", "2.47", "0.600"]
    assert hold[3] == "-"
    report = {"settings": [{"setting": "33", "n_cells": 3}, {"setting": "200", "n_cells": 3}], "orientation": rows}
    table = turn_ratio_table(report)
    assert table.columns == ["orientation, deg (ratio)", "33", "200"]
    assert table.rows[1] == ["tangent_ls", "2.47 (0.600)", "2.47 (0.600)"]
    assert turn_ratio_table(report, degrees=False).rows[1] == ["tangent_ls", "0.600", "0.600"]


def lacking(*counts: str) -> list[list[dict[str, Any]]]:
    """The first person, and the sums of one whose recording lacks what ``counts`` count."""
    (one,) = PEOPLE[0]
    sums = {"n_scored": "sse_rad2", "n_gripper_scored": "sse_gripper_rad2"}
    none = {name: 0 for count in counts for name in (count, sums[count])}
    return [[one], [{"orientation": {name: entry | none for name, entry in one["orientation"].items()}}]]


def test_who_neither_turns_nor_grips_changes_no_score() -> None:
    whole, others = lacking("n_scored", "n_gripper_scored")
    assert orientation_rows({}, [others]) == []
    for row, alone in zip(orientation_rows({}, [whole, others]), orientation_rows({}, [whole]), strict=True):
        assert [row[name] for name in ("rms_deg", "gripper_rms_rad")] == [alone["rms_deg"], alone["gripper_rms_rad"]]


def test_a_table_without_a_gripper_has_no_columns_for_it() -> None:
    whole, others = lacking("n_gripper_scored")
    rows = orientation_rows({"setting": None}, [others])
    assert rows[1]["rms_deg"] == pytest.approx(2.0)
    heads = [column.head for column in turn_table(rows).full_columns()]
    assert heads == ["orientation", "deg", "ratio", "95 %", "cover", "\u00b5s", "p99"]
    assert "gripper rad" in [column.head for column in turn_table(orientation_rows({}, [whole])).full_columns()]
