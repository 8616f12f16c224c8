"""Figures of a few rows, computed by hand."""

import pytest

from tis.deploy.watch.arms import TrackRow
from tis.deploy.watch.live_figures import CrossingFigures, LiveFigures, crossing_figures, live_figures
from tis.deploy.watch.streams import Crossing

MS = 1_000_000
NOWHERE = (0.0, 0.0, 0.0)


def test_crossings_are_counted_and_only_what_arrived_has_a_delay() -> None:
    found = crossing_figures([Crossing(0, 10 * MS), Crossing(1, None), Crossing(2, 30 * MS), Crossing(3, 20 * MS)])
    assert (found.n, found.n_lost, found.loss_pct, found.delay_p50_ms) == (4, 1, 25.0, 20.0)


def test_of_nothing_nothing_is_known() -> None:
    assert crossing_figures([]) == CrossingFigures()
    assert CrossingFigures().loss_pct is None
    empty = live_figures({}, [], [])
    assert empty == LiveFigures()
    assert empty.ratio_to_hold is None


def test_errors_are_pooled_over_ticks_and_compared_with_holds() -> None:
    rows = [TrackRow(i, NOWHERE, NOWHERE, NOWHERE, error, hold) for i, (error, hold) in enumerate([(3, 6), (4, 8)])]
    found = live_figures({"arm": [Crossing(0, None)]}, [70.0, 80.0], [rows])
    assert found.rmse_mm == pytest.approx((25 / 2) ** 0.5)
    assert found.hold_rmse_mm == pytest.approx((100 / 2) ** 0.5)
    assert found.ratio_to_hold == pytest.approx(0.5)
    assert (found.end_to_end_p50_ms, found.end_to_end_p99_ms) == pytest.approx((75.0, 79.9))
    assert found.streams["arm"].loss_pct == 100


def test_a_hold_without_error_has_no_ratio() -> None:
    for at_rest_mm in (0.0, 1e-12):
        assert LiveFigures(rmse_mm=1.0, hold_rmse_mm=at_rest_mm).ratio_to_hold is None
