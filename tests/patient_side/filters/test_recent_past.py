"""The recent past as states: against increments and running means of the path itself."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.arm_models import RATE_HZ, slow_movement
from tests.patient_side.movements import drawn, movement_model
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter, build_innovations_filter
from tis.patient_side.filters.recent_past import RecentPast
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import MEANS_S, N_INCREMENTS

PAST = RecentPast.at_rate(RATE_HZ)
HORIZON = 30


def filtered(filter_: InnovationsFilter, y: Array, rows: list[int]) -> tuple[Array, Array]:
    mean, covariance = filter_.start(y[rows[0]])
    for last, row in pairwise(rows):
        mean, covariance, _ = filter_.update(mean, covariance, row - last, y[row])
    return mean.ravel(), covariance


@pytest.mark.parametrize("integrated", [False, True])
def test_of_an_unbroken_row_it_is_what_was_seen(integrated: bool) -> None:
    y = drawn(movement_model(3, integrated=integrated), 80, np.random.default_rng(1))
    filter_ = build_innovations_filter(movement_model(3, integrated=integrated), HORIZON, past=PAST)
    mean, _ = filtered(filter_, y, list(range(len(y))))
    increments = mean[: AXES * N_INCREMENTS].reshape(-1, AXES)
    assert increments == pytest.approx(np.diff(y, axis=0)[::-1][:N_INCREMENTS], abs=1e-12)
    # Running means that begin at the first sample.
    ways = mean[AXES * N_INCREMENTS : AXES * PAST.n_states].reshape(-1, AXES)
    for way, mean_s in zip(ways, MEANS_S, strict=True):
        at = y[0]
        for sample in y[1:]:
            at = at + (1 - np.exp(-1 / (RATE_HZ * mean_s))) * (sample - at)
        assert way == pytest.approx(y[-1] - at, abs=1e-12)


@settings(max_examples=20, deadline=None)
@given(gap=st.integers(2, 4), seed=st.integers(0, 99))
def test_increments_over_missing_samples_add_up_to_the_way_between(gap: int, seed: int) -> None:
    """What lies between is guessed, and the sum is known."""
    y = drawn(slow_movement(), 60, np.random.default_rng(seed))
    filter_ = build_innovations_filter(slow_movement(), HORIZON, past=PAST)
    rows = [*range(40), 39 + gap]
    mean, covariance = filtered(filter_, y, rows)
    increments = mean[: AXES * N_INCREMENTS].reshape(-1, AXES)
    assert increments[:gap].sum(axis=0) == pytest.approx(y[39 + gap] - y[39], abs=1e-9)
    # A single increment is uncertain.
    assert covariance[0, 0] > 1e-6 * filter_.noises[1][-1, -1]


@pytest.mark.parametrize("whole", [False, True])
def test_it_changes_no_forecast(whole: bool) -> None:
    y = drawn(slow_movement(), 50, np.random.default_rng(2))
    rows = [*range(20), 22, 23, 27, *range(30, 50)]
    forecasts = []
    for past in (None, PAST):
        filter_ = build_innovations_filter(slow_movement(), HORIZON, whole=whole, past=past)
        mean, covariance = filtered(filter_, y, rows)
        position = filter_.weights(7, 0.4) @ mean.reshape(filter_.n_states, -1)
        forecasts.append((position.ravel(), filter_.spread(covariance, 7, 0.4)))
    assert forecasts[1][0] == pytest.approx(forecasts[0][0], rel=1e-9)
    assert forecasts[1][1] == pytest.approx(forecasts[0][1], rel=1e-6)
