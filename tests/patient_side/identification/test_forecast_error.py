import numpy as np
import pytest

from tests.patient_side.arm_models import LOST, Streams, delayed, play, positions
from tests.patient_side.movements import drawn, movement_model, moving_arm
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.filters.activity import ActivityMean
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.identification.level_and_scale import HeldBack, error_over_hold

STRUCTURES = pytest.mark.parametrize("integrated", [False, True])


@STRUCTURES
def test_trials_side_by_side_are_forecast_as_the_estimator_forecasts_each(integrated: bool) -> None:
    model = movement_model(4, integrated=integrated)
    trials = tuple(drawn(model, n, np.random.default_rng(n)) for n in (80, 50))
    filter_ = build_innovations_filter(model, 10)
    held_back = HeldBack(trials, (30, 20))
    means, activities = held_back.run(filter_, Unbroken.of(filter_, 100), ActivityMean.at_rate(30))
    assert [state.shape[0] for state in means] == [50, 30]
    assert all(
        np.array_equal(a, b)
        for a, b in zip(means, held_back.filtered(filter_, Unbroken.of(filter_, 100)), strict=True)
    )
    errors = held_back.forecast_errors(filter_, means, 3)
    for y, first, error, state, activity in zip(trials, held_back.first_rows, errors, means, activities, strict=True):
        streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), 100_000_000))
        said = positions(play(InnovationsKf(moving_arm(model)), streams))[first + 3 :]
        # at a tick the age is 100 ms, three samples, and 2 ms more: 0.06 of a sample
        a_little_more = state[:-3] @ (filter_.weights(3, 0.06) - filter_.output(3)).T
        assert np.max(np.abs(y[first + 3 :] - error + a_little_more - said)) < 1e-9
        assert np.all(activity > 0)


def test_moves_are_the_errors_of_holding() -> None:
    y = np.arange(30.0).reshape(10, 3) ** 2
    held_back = HeldBack((y,), (4,))
    assert np.array_equal(held_back.moves(2)[0], y[6:] - y[4:8])
    assert held_back.moves(6)[0].shape == (0, 3)
    assert held_back.n_rows == 6


def test_the_error_is_a_geometric_mean_over_trials_and_horizons() -> None:
    model = movement_model(3)
    calm, lively = drawn(model, 300, np.random.default_rng(1)), drawn(model, 300, np.random.default_rng(2))
    filter_ = build_innovations_filter(model, 10)
    unbroken = Unbroken.of(filter_, 300)
    one, other = (HeldBack((y,), (100,)) for y in (calm, lively))
    both = HeldBack((calm, 100 * lively), (100, 100))
    parts = [error_over_hold(h, filter_, unbroken, [s]) for h in (one, other) for s in (1, 4)]
    assert error_over_hold(both, filter_, unbroken, [1, 4]) == pytest.approx(float(np.exp(np.mean(np.log(parts)))))
