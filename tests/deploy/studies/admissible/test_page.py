"""The page of admissible networks against a report written by hand."""

from typing import Any

import pytest

from tests.deploy.report.outline import Outline
from tis.deploy.studies.admissible.plots import admissible_html
from tis.deploy.studies.admissible.tables import answer, regions

AXIS: dict[str, Any] = {"path": "network.forward.delay.delay_ms", "first": 20.0, "last": 400.0, "log": False}

PEOPLE = [f"synthetic {seed}" for seed in range(7, 23)]


def report() -> dict[str, Any]:
    check = {"optimistic": 0, "n_inside": 5, "overlooked": 1, "n_outside": 5}
    about = {
        "start": {AXIS["path"]: 20.0},
        "alone": {AXIS["path"]: 70.86},
        "beyond": {AXIS["path"]: 72.4},
        "n_rays": 15,
        "at_border": [{"figures": [1.25, 1.25], "bounds": [1.96, 1.96]}],
        "check": check,
        "border": [],
        "outline": [],
    }
    profile = {
        "name": "a<b>", "forward": {"mean_ms": 3.0, "loss_pct": 0.1, "outage_pct": 0.0}, "fault": None, "at": None,
        "verdicts": {"hold": {"inside": False}, "mine": {"inside": True}}, "redundancy": {"hold": None, "mine": None},
    }  # fmt: skip
    return {
        "warnings": ["one seed: no <draws>"],
        "scenario": "s", "command": "tis admissible s --limit 'rmse_3d_mm=<2>'", "trained_on": "heads", "n_seeds": 1,
        "limits": [{"name": "rmse_3d_mm", "at_most": True, "value": 2.0}], "axes": [AXIS | {"whole": False}],
        "persons": PEOPLE, "synthetic": PEOPLE, "n_points": 9, "n_twins": 18, "points": [],
        "estimators": {"hold": about | {"share": 0.126}, "mine": about | {"share": 0.387}},
        "profiles": [profile, profile], "profiles_tried": [],
    }  # fmt: skip


OTHER_AXIS = {"path": "network.forward.loss.p_loss", "first": 0.0, "last": 0.3, "log": False, "whole": False}


def test_with_several_axes_the_answer_ranks_the_estimators_by_their_share() -> None:
    plane = report()
    plane["axes"].append(OTHER_AXIS)
    assert answer(plane).startswith(
        "With mine, rmse_3d_mm<=2 holds in 38.7 % of the box of networks; with hold 12.6 %. Of 2 profiles of the "
        "library 2 are admissible with mine. The 95 % confidence rests on 16 synthetic people."
    )
    assert "with hold 12.6 %. The" in answer(plane | {"profiles": []})


def test_with_one_axis_the_answer_is_the_delay_with_the_error_beside_its_bound() -> None:
    text = answer(report())
    assert text.startswith("With mine, rmse_3d_mm<=2 holds up to delay_ms = 70 (no longer at 73); with hold up to")
    assert text.endswith("at mine's border rmse_3d_mm is 1.25, its bound 1.96.")
    assert "of the box" not in text
    assert regions(report()).rows[0][:5] == ["hold", "70", "73", "1.25", "1.96"]


def test_fewer_people_than_a_claim_takes_are_told() -> None:
    assert "too few" not in answer(report())
    assert "rests on 5 people: too few for a claim about others, which takes 6" in answer(
        report() | {"persons": list("DEFGH"), "synthetic": []}
    )


@pytest.mark.parametrize(
    ("start", "inside", "outside", "words"),
    [
        (20.0, 86.05, 92.44, "up to delay_ms = 86 (no longer at 93)"),
        (20.0, 20.4, 33.0, "up to delay_ms = 20 (no longer at 40)"),
        (20.0, 399.0, 400.0, "up to delay_ms = 399 (no longer at 400)"),
        (20.0, 20.0001234, 20.0004, "up to delay_ms = 20.0001 (no longer at 20.0004)"),
        (400.0, 92.44, 86.05, "down to delay_ms = 93 (no longer at 86)"),
        (20.0, 400.0, None, "at all of delay_ms 20 to 400"),
        (20.0, None, 20.0, "nowhere"),
    ],
)
def test_a_border_has_no_more_digits_than_were_resolved(
    start: float, inside: float | None, outside: float | None, words: str
) -> None:
    one, path = report(), AXIS["path"]
    one["estimators"]["mine"] |= {"start": {path: start}, "alone": {path: inside}, "beyond": {path: outside}}
    assert f"holds {words};" in answer(one)


def test_the_page_is_whole_without_a_server_and_with_names_of_others() -> None:
    page = Outline(admissible_html(report(), b"<svg/>"))
    assert page.faults() == []
    assert all(place.startswith(("data:", "#")) for place in page.fetched)
    assert "a<b>" in page.text
    assert "rmse_3d_mm=<2>" in page.text
    assert "one seed: no <draws>" in page.text
    assert 'id="regions"' not in admissible_html(report(), None)
