"""The page of admissible networks against a report written by hand."""

from typing import Any

from tests.deploy.report.outline import Outline
from tis.deploy.studies.admissible.page import admissible_html, answer

AXIS: dict[str, Any] = {"path": "network.forward.delay.delay_ms", "first": 20.0, "last": 400.0, "log": False}

PEOPLE = [f"synthetic {seed}" for seed in range(7, 23)]


def report() -> dict[str, Any]:
    check = {"optimistic": 0, "n_inside": 5, "overlooked": 1, "n_outside": 5}
    about = {"alone": {AXIS["path"]: 70.0}, "n_rays": 15, "check": check, "border": [], "outline": []}
    profile = {
        "name": "a<b>", "forward": {"mean_ms": 3.0, "loss_pct": 0.1, "outage_pct": 0.0}, "fault": None, "at": None,
        "verdicts": {"hold": {"inside": False}, "mine": {"inside": True}}, "redundancy": {"hold": None, "mine": None},
    }  # fmt: skip
    return {
        "scenario": "s", "command": "tis admissible s --limit 'rmse_3d_mm=<2>'", "trained_on": "heads", "n_seeds": 1,
        "limits": [{"name": "rmse_3d_mm", "at_most": True, "value": 2.0}], "axes": [AXIS | {"whole": False}],
        "persons": PEOPLE, "synthetic": PEOPLE, "n_points": 9, "n_twins": 18, "points": [],
        "estimators": {"hold": about | {"share": 0.126}, "mine": about | {"share": 0.387}},
        "profiles": [profile, profile], "profiles_tried": [],
    }  # fmt: skip


def test_the_answer_ranks_the_estimators_by_their_share() -> None:
    assert answer(report()) == (
        "With mine, rmse_3d_mm<=2 holds in 38.7 % of the box of networks; with hold 12.6 %. Of 2 profiles of the "
        "library 2 are admissible with mine. The 95 % confidence rests on 16 synthetic people."
    )
    assert "with hold 12.6 %. The" in answer(report() | {"profiles": []})


def test_the_page_is_whole_without_a_server_and_with_names_of_others() -> None:
    page = Outline(admissible_html(report(), b"<svg/>"))
    assert page.faults() == []
    assert all(place.startswith(("data:", "#")) for place in page.fetched)
    assert "a<b>" in page.text
    assert "rmse_3d_mm=<2>" in page.text
    assert 'id="regions"' not in admissible_html(report(), None)
