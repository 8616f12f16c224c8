"""The correction of a forecast: against the same in arrays, and by what must not matter."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.arm_models import LOST, RATE_HZ, Streams, delayed, play, positions, slow_movement
from tests.patient_side.movements import drawn, movement_model, moving_arm
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.filters.correction import (
    N_MOVEMENT_TERMS,
    CorrectionForecasts,
    LagCorrection,
    Movement,
    compressed,
    fade,
    largest_increment,
    log_speed,
    movement_terms,
    movements,
    openness,
    projections,
)
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter, build_innovations_filter
from tis.patient_side.filters.recent_past import RecentPast
from tis.patient_side.filters.row_clock import NO_PHASE, RowClock
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import MEANS_S, N_PARTS, N_TERMS, Correction

HORIZON = 12
KNOTS = np.array([1.0, 4.0, 9.0])
USUAL_RAD, SPREAD_RAD = -0.4, 0.5
N_FEATURES = 5
PAST = RecentPast.at_rate(RATE_HZ)


def correction(seed: int = 0, *, clock: float = 0.29, n_features: int = N_FEATURES, scale: float = 0.3) -> Correction:
    rng = np.random.default_rng(seed)
    return Correction(
        span=2,
        usual_m=1e-3,
        lowest=-1.5,
        highest=0.5,
        largest=3.0,
        gripper_usual_rad=USUAL_RAD,
        gripper_spread_rad=SPREAD_RAD,
        clock=clock,
        horizons=KNOTS,
        weights=scale * rng.normal(size=(len(KNOTS), N_PARTS, N_TERMS)),
        widths=rng.uniform(0.5, 2, len(MEANS_S)),
        centre=rng.normal(size=AXES * len(MEANS_S) + 2),
        deviation=rng.uniform(0.2, 2, AXES * len(MEANS_S) + 2),
        fourier=scale * rng.normal(size=(len(KNOTS), AXES, n_features)),
        linear_scale=np.array([1.0, 2.0, 3.0]),
    )


def filter_of(integrated: bool = False, *, alike: bool = False) -> InnovationsFilter:
    model = slow_movement() if alike else movement_model(3, integrated=integrated)
    return build_innovations_filter(model, HORIZON, past=PAST)


def some_mean(filter_: InnovationsFilter, seed: int) -> Array:
    return 1e-3 * np.random.default_rng(seed).normal(size=filter_.start(np.zeros(3))[0].shape)


def at_lag(model: Correction, filter_: InnovationsFilter, lag: float) -> LagCorrection:
    steps = int(lag)
    return CorrectionForecasts.of(model, filter_).at(filter_.weights(steps, lag - steps), steps, lag - steps)


def by_arrays(
    filter_: InnovationsFilter, model: Correction, mean: Array, activity: float, gripper_rad: float, lag: float
) -> Array:
    """The equation of the module, with matrices; the clock's phasor is (0.1 + 0.2 i, 3)."""
    moved, unit = movements(filter_, model.span, mean.reshape(1, -1)), np.array([model.usual_m * np.sqrt(activity)])
    x = np.clip(log_speed(moved.velocity, unit), model.lowest, model.highest)
    g = openness(np.array([gripper_rad]), model.gripper_usual_rad, model.gripper_spread_rad)
    terms = np.append(movement_terms(moved, x, g)[0], RowClock(model.clock, 1.0).terms((0.1 + 0.2j, 3.0)))

    def at(values: Array) -> Array:
        flat = np.vstack([np.zeros((1, values[0].size)), values.reshape(len(KNOTS), -1)])
        return np.array([np.interp(lag, [0.0, *KNOTS], column) for column in flat.T]).reshape(values.shape[1:])

    weights = at(model.weights)
    if lag < 1:
        weights[0] = model.weights[0, 0]
    steps, y = int(lag), mean.ravel()[-AXES:]
    move = (filter_.weights(steps, lag - steps) @ mean).ravel() - y
    parts = np.vstack([move, moved.parts[0]])
    share = fade(largest_increment(moved, unit), model.largest)[0]
    drawn = projections(model.centre, model.deviation, N_FEATURES)
    features = np.cos(drawn[:, :-1] @ compressed(moved.ways, unit, model.widths, x, g)[0] + drawn[:, -1])
    return np.asarray(y + move + share * (weights @ terms) @ parts + unit[0] * at(model.fourier) @ features)


@settings(max_examples=30, deadline=None)
@given(
    seed=st.integers(0, 999),
    lag=st.floats(1, HORIZON),
    activity=st.floats(0.1, 10),
    gripper_rad=st.floats(-2, 2),
    integrated=st.booleans(),
    alike=st.booleans(),
)
def test_plain_numbers_say_what_arrays_do(
    seed: int, lag: float, activity: float, gripper_rad: float, integrated: bool, alike: bool
) -> None:
    filter_, model = filter_of(integrated, alike=alike), correction(seed)
    mean = some_mean(filter_, seed)
    found = at_lag(model, filter_, lag).position(mean, activity, gripper_rad, (0.1 + 0.2j, 3.0))
    expected = by_arrays(filter_, model, mean, activity, gripper_rad, lag)
    assert found == pytest.approx(expected, rel=1e-9, abs=1e-12)


def test_an_unknown_gripper_counts_as_one_of_the_usual_opening() -> None:
    filter_, model = filter_of(), correction()
    mean = some_mean(filter_, 6)
    usual = at_lag(model, filter_, 5).position(mean, 1.0, USUAL_RAD, NO_PHASE)
    assert np.array_equal(at_lag(model, filter_, 5).position(mean, 1.0, None, NO_PHASE), usual)
    opened = at_lag(model, filter_, 5).position(mean, 1.0, USUAL_RAD + SPREAD_RAD, NO_PHASE)
    assert np.max(np.abs(opened - usual)) > 1e-5
    still = at_lag(replace(model, gripper_spread_rad=0.0), filter_, 5)
    assert np.array_equal(still.position(mean, 1.0, USUAL_RAD + SPREAD_RAD, NO_PHASE), usual)
    assert np.array_equal(openness(np.array([1.0, 2.0]), 1.0, 0.0), np.zeros(2))


def test_without_lag_the_arm_is_where_it_was_seen() -> None:
    filter_ = filter_of()
    mean = some_mean(filter_, 1)
    assert at_lag(correction(), filter_, 0).position(mean, 1.0, None, NO_PHASE) == pytest.approx(mean.ravel()[-AXES:])


def test_within_the_first_sample_the_forecast_is_linear_as_truth_is() -> None:
    filter_ = filter_of()
    mean = some_mean(filter_, 4)
    at = {lag: at_lag(correction(), filter_, lag).position(mean, 1.0, None, NO_PHASE) for lag in (0.0, 0.3, 1.0)}
    assert at[0.3] == pytest.approx(0.7 * at[0.0] + 0.3 * at[1.0])


def test_coefficients_prefer_no_direction_and_no_size() -> None:
    """Without Fourier features a movement that is turned, and larger by its activity, is forecast so."""
    filter_ = filter_of(alike=True)
    lagging, mean = at_lag(correction(n_features=0), filter_, 7.5), some_mean(filter_, 2)
    turn = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    one = lagging.position(mean, 1.0, None, NO_PHASE)
    other = lagging.position(3.0 * mean @ turn.T, 9.0, None, NO_PHASE)
    assert other == pytest.approx(3.0 * turn @ one)


def test_after_a_jump_the_coefficients_fade_into_the_linear_forecast() -> None:
    filter_ = filter_of()
    lagging, mean = at_lag(correction(n_features=0), filter_, 4), np.zeros((filter_.n_states, 1))
    mean[-AXES:, 0] = 1e-4, 2e-4, 0.0
    linear, distances = filter_.weights(4, 0.0), []
    for jump_m in (1e-3, 1e-2, 1e-1):
        mean[:AXES, 0] = jump_m, 0.0, 0.0
        off = lagging.position(mean, 1.0, None, NO_PHASE) - (linear @ mean).ravel()
        distances.append(float(np.linalg.norm(off)) / jump_m)
    assert distances[1] < 0.2 * distances[0]
    assert distances[2] < 0.02 * distances[1]


def test_the_terms_tell_speed_and_braking_apart() -> None:
    along, nothing = np.array([[1.0, 0.0, 0.0]]), np.zeros((1, len(MEANS_S), AXES))
    parts = np.zeros((1, N_PARTS - 1, AXES))
    parts[:, 0] = along
    for factor, braking in ((0.5, 1.0), (-0.5, -1.0)):
        moved = Movement(parts, nothing, factor * along)
        (row,) = movement_terms(moved, np.array([0.3]), np.array([0.7]))
        assert row == pytest.approx([1.0, 0.3, 0.09, braking, 0.3 * braking, 0.09 * braking, 0.7])
    (rest,) = movement_terms(Movement(0 * parts, nothing, 0 * along), np.array([-2.0]), np.zeros(1))
    assert rest == pytest.approx([1.0, -2.0, 4.0, 0.0, 0.0, 0.0, 0.0])
    assert len(rest) == N_MOVEMENT_TERMS


def test_an_estimator_goes_by_it() -> None:
    """Weights of nothing change nothing; others change what is foreseen, and not what was seen."""
    linear = movement_model(3)
    y, found = drawn(linear, 60, np.random.default_rng(3)), []
    for scale in (None, 0.0, 1.0):
        model = replace(linear, correction=None if scale is None else correction(3, scale=scale))
        streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), 100_000_000))
        found.append(play(InnovationsKf(moving_arm(model)), streams)[20:])
    without, nothing, much = (positions(each) for each in found)
    assert nothing == pytest.approx(without, abs=1e-12)
    assert np.max(np.abs(much - without)) > 1e-5
    for one, other in zip(found[0], found[2], strict=True):
        assert np.asarray(one.covariance_m2) == pytest.approx(np.asarray(other.covariance_m2), rel=1e-6)


def test_the_gripper_counts_at_the_newest_sample_or_the_last_known_one_before() -> None:
    linear = movement_model(3)
    y, found = drawn(linear, 60, np.random.default_rng(3)), {}
    estimator = InnovationsKf(moving_arm(replace(linear, correction=correction())))
    for name, angles in (("none", None), ("usual", np.full(60, USUAL_RAD)), ("opens", np.arange(60.0) - 30.0)):
        streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), 100_000_000), angles)
        found[name] = positions(play(estimator, streams))[20:]
    assert np.array_equal(found["none"], found["usual"])
    assert np.all(np.any(found["none"] != found["opens"], axis=1))


def test_a_late_sample_leaves_the_state_that_it_would_have_left_in_time() -> None:
    """Increments, running means and the clock's phase are replayed as well."""
    linear = movement_model(3)
    y = drawn(linear, 80, np.random.default_rng(5))
    estimator = InnovationsKf(moving_arm(replace(linear, correction=correction())), window=10)
    in_time = delayed(len(y), 33_000_000)
    late = list(in_time)
    late[70] += 100_000_000
    said = [play(estimator, Streams(np.zeros_like(y), y, [LOST] * len(y), each)) for each in (in_time, late)]
    assert positions(said[0])[-1] == pytest.approx(positions(said[1])[-1], abs=1e-9)


def test_a_hand_at_rest_stays_finite() -> None:
    filter_, model = filter_of(), correction(n_features=0)
    still = at_lag(model, filter_, 3).position(np.zeros((filter_.n_states, 1)), 0.0, None, NO_PHASE)
    assert np.array_equal(still, np.zeros(3))
    jumpy = at_lag(correction(), filter_, 3).position(1e3 * np.ones((filter_.n_states, 1)), 0.0, None, NO_PHASE)
    assert np.all(np.isfinite(jumpy))
