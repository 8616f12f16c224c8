"""Why hold errs less: one cause each, and nothing that is not known."""

from typing import Any

import pytest

from tis.deploy.run.resolve import resolve
from tis.deploy.view.hold_reason import RunAbout, about_of, why_hold
from tis.deploy.watch.live_figures import LiveFigures

LIVE = RunAbout(600, 30, "innovations_kf", is_trained_on_synthetic=True, is_live=True)
RECORDED = RunAbout(600, 30, "innovations_kf", is_trained_on_synthetic=True, is_live=False)


def _figures(**changes: Any) -> LiveFigures:
    return LiveFigures(**{"rmse_mm": 2.0, "hold_rmse_mm": 1.0, "extent_mm": 40.0, "age_max_ms": 150.0} | changes)


@pytest.mark.parametrize(
    ("found", "about", "cause"),
    [
        (_figures(extent_mm=0.2), LIVE, "the hand rests"),
        (_figures(age_max_ms=900.0, gap_max_ms=800.0), LIVE, "nothing newer arrived for up to 800 ms"),
        (_figures(age_max_ms=635.0, gap_max_ms=34.0), LIVE, "the newest position was up to 635 ms old"),
        (_figures(age_max_ms=20.0), LIVE, "at most 20 ms old"),
        (_figures(), LIVE, "identified on synthetic movement"),
        (_figures(), RECORDED, "Nothing that this page sees"),
        (_figures(), None, "Nothing that this page sees"),
    ],
)
def test_each_cause_is_told_by_what_is_known(found: LiveFigures, about: RunAbout | None, cause: str) -> None:
    assert cause in why_hold(found, about)


def test_where_the_estimate_errs_less_or_nothing_is_known_nothing_is_said() -> None:
    assert why_hold(_figures(rmse_mm=0.5), LIVE) == ""
    assert why_hold(LiveFigures(), LIVE) == ""
    assert why_hold(_figures(rmse_mm=0.004, hold_rmse_mm=0.001, extent_mm=0.0), LIVE) == "", "both are shown as 0.00"


def test_a_drive_says_that_its_estimate_is_hold() -> None:
    about = about_of(resolve("drive"))
    assert (about.duration_s, about.is_live, about.active_estimator) == (600, True, "hold")
    assert "is hold in this run" in why_hold(LiveFigures(), about)
    assert not about_of(resolve("default")).is_live
