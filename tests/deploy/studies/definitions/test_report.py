"""Published figures beside ours: which rows their texts allow, and the verdict."""

from dataclasses import replace
from typing import Any

import pytest

from tis.deploy.studies.definitions.published import PUBLISHED, Published
from tis.deploy.studies.definitions.readings import HORIZONS_S, READINGS, SPLITS
from tis.deploy.studies.definitions.report import beside, standing, verdict

EXACT = Published(
    name="made up",
    citation="nobody: nothing",
    read="all of it",
    figure="2 mm at 1 s",
    mm=2.0,
    horizon_s=1.0,
    says="everything",
    leaves_open=(),
    errors=("rmse_3d",),
    spans=("at",),
    splits=("user",),
)


@pytest.fixture
def rows() -> list[dict[str, Any]]:
    """All rows; our error at 1 s is the row's number in mm, hold's twice that."""
    found: list[dict[str, Any]] = []
    for split in SPLITS:
        for reading in READINGS:
            number = len(found) + 1
            mm = {"hold": [2.0 * number] * len(HORIZONS_S), "innovations_kf": [1.0 * number] * len(HORIZONS_S)}
            found.append({"row": number, "split": split, "error": reading.error, "span": reading.span, "mm": mm})
    return found


def test_a_text_that_leaves_nothing_open_is_comparable_with_one_row(rows: list[dict[str, Any]]) -> None:
    entry = beside(EXACT, rows)
    assert entry["rows"] == [1]
    assert entry["ours_mm"] == {"hold": [2.0, 2.0], "innovations_kf": [1.0, 1.0]}
    assert entry["verdict"] == "comparable"
    assert standing(entry) == "above the range of"


def test_what_a_text_leaves_open_makes_it_not_comparable(rows: list[dict[str, Any]]) -> None:
    entry = beside(replace(EXACT, spans=("at", "up_to_10_hz"), leaves_open=("the span",)), rows)
    assert entry["rows"] == [1, 9]
    assert standing(entry) == "within the range of"
    reasons = "the text that was read allows 2 rows; it leaves open: the span"
    assert entry["verdict"] == f"not comparable, because {reasons}"
    assert standing(beside(replace(EXACT, mm=0.5), rows)) == "below the range of"
    rows[0]["mm"]["innovations_kf"] = [1.004] * len(HORIZONS_S)
    assert standing(beside(replace(EXACT, mm=1.0), rows)) == "within the range of"


def test_a_figure_without_a_row_or_a_distance_is_not_comparable(rows: list[dict[str, Any]]) -> None:
    assert verdict(EXACT, 0) == "not comparable, because there is no row of ours that its text allows"
    entry = beside(replace(EXACT, mm=None, horizon_s=None, differs=("it is no distance",)), rows)
    assert entry["rows"] == []
    assert entry["verdict"] == "not comparable, because it is no distance"
    assert standing(entry) == ""


@pytest.mark.parametrize("published", PUBLISHED, ids=lambda each: each.name)
def test_every_published_figure_names_its_source_and_what_is_open(
    published: Published, rows: list[dict[str, Any]]
) -> None:
    assert published.citation
    assert published.read
    assert published.leaves_open
    assert bool(beside(published, rows)["rows"]) == (published.mm is not None)
