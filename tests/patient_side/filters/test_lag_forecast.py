from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.movements import movement_model
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.filters.lag_forecast import LagForecasts
from tis.patient_side.filters.unbroken import Unbroken

MS = 1_000_000


@pytest.fixture
def forecasts() -> LagForecasts:
    model = replace(
        movement_model(3, integrated=True),
        scale_horizons=np.array([2.0, 4.0]),
        covariance_scale=np.array([1.0, 3.0]),
    )
    filter_ = build_innovations_filter(model, 10)
    return LagForecasts.of(model, filter_, Unbroken.of(filter_, 100), 30)


@pytest.mark.parametrize(("lag_ms", "factor"), [(0, 1), (50, 1), (100, 2), (125, 2.75), (250, 3), (9000, 3)])
def test_the_scale_is_linear_between_its_horizons(forecasts: LagForecasts, lag_ms: int, factor: float) -> None:
    covariance = forecasts.unbroken.covariances[5]
    samples = min(lag_ms * 30 / 1000, 10.0)
    weights = forecasts.filter.weights(int(samples), samples % 1)
    plain = forecasts.filter.spread(covariance, int(samples), samples % 1)
    forecast = forecasts.after(covariance, lag_ms * MS)
    assert np.allclose(forecast.weights, weights)
    assert np.allclose(forecast.spread, factor * plain)


def test_what_is_kept_is_what_would_be_worked_out(forecasts: LagForecasts) -> None:
    for length in (3, 60, 3, 61, 60):
        for lag_ns in (102 * MS, 102 * MS + 1, 35 * MS):
            kept = forecasts.after_unbroken(length, lag_ns)
            stage = forecasts.unbroken.spread_stage(length)
            fresh = forecasts.after(forecasts.unbroken.covariances[stage], lag_ns)
            assert np.array_equal(kept.weights, fresh.weights)
            assert np.array_equal(kept.spread, fresh.spread)
    assert forecasts.after_unbroken(60, 35 * MS) is forecasts.after_unbroken(60, 35 * MS)


def test_it_keeps_a_bounded_number(forecasts: LagForecasts) -> None:
    for lag_ns in range(0, 200_000, 64):
        forecasts.after_unbroken(9, lag_ns)
    assert len(forecasts._kept) <= 500
    assert len(forecasts._lags) <= 500


def test_nobody_can_write_to_what_is_kept(forecasts: LagForecasts) -> None:
    with pytest.raises(ValueError, match="read-only"):
        forecasts.after_unbroken(9, 35 * MS).spread[0, 0] = 1.0
