"""What bends a forecast: against the same in arrays, and by what must not matter."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from patient_side.estimators.innovations_kf import InnovationsKf
from patient_side.filters.innovations_filter import AXES, InnovationsFilter, build_innovations_filter
from patient_side.filters.reach import N_PARTS, N_TERMS, Phase, ReachForecasts, openness, phases, terms
from patient_side.statespace import Array, Reach
from tests.patient_side.arm_models import LOST, Streams, delayed, play, positions, slow_movement
from tests.patient_side.movements import drawn, movement_model, moving_arm

HORIZON = 12
KNOTS = np.array([1.0, 4.0, 9.0])
USUAL_RAD, SPREAD_RAD = -0.4, 0.5


def bent(filter_: InnovationsFilter, seed: int = 0) -> tuple[Reach, ReachForecasts]:
    weights = np.random.default_rng(seed).normal(size=(len(KNOTS), N_PARTS, N_TERMS))
    reach = Reach(2, 1e-3, -1.5, 0.5, USUAL_RAD, SPREAD_RAD, KNOTS, weights)
    return reach, ReachForecasts.of(reach, filter_)


def by_arrays(
    filter_: InnovationsFilter, reach: Reach, mean: Array, activity: float, gripper_rad: float, lag: float
) -> Array:
    """The equation of the module, with matrices."""
    phase = phases(filter_, reach.span, mean[None], np.array([activity]), reach.usual_m)
    steps, y = int(lag), mean[-AXES:]
    knots = np.vstack([reach.weights[:1], reach.weights]).reshape(1 + len(KNOTS), -1)
    knots[0, N_TERMS:] = 0.0
    weights = np.array([np.interp(lag, [0.0, *KNOTS], column) for column in knots.T]).reshape(N_PARTS, N_TERMS)
    move = filter_.weights(steps, lag - steps) @ mean - y
    parts = np.stack([move, phase.velocity[0], phase.to_level[0]])
    opening = openness(np.array([gripper_rad]), reach.gripper_usual_rad, reach.gripper_spread_rad)
    return np.asarray(y + move + (weights @ terms(phase, opening, reach.lowest, reach.highest)[0]) @ parts)


@settings(max_examples=25, deadline=None)
@given(
    seed=st.integers(0, 999),
    lag=st.floats(0, HORIZON),
    activity=st.floats(0.1, 10),
    gripper_rad=st.floats(-2, 2),
    integrated=st.booleans(),
)
def test_plain_numbers_say_what_arrays_do(
    seed: int, lag: float, activity: float, gripper_rad: float, integrated: bool
) -> None:
    filter_ = build_innovations_filter(movement_model(3, integrated=integrated), HORIZON)
    reach, forecasts = bent(filter_, seed)
    mean = 1e-3 * np.random.default_rng(seed).normal(size=len(filter_.one_step))
    bend = forecasts.bend(filter_.weights(int(lag), lag - int(lag)), int(lag), lag - int(lag))
    assert bend.position(mean, activity, gripper_rad) == pytest.approx(
        by_arrays(filter_, reach, mean, activity, gripper_rad, lag), rel=1e-9, abs=1e-12
    )


def test_an_unknown_gripper_counts_as_one_of_the_usual_opening() -> None:
    filter_ = build_innovations_filter(slow_movement(), HORIZON)
    reach, forecasts = bent(filter_)
    mean = 1e-3 * np.random.default_rng(6).normal(size=len(filter_.one_step))
    bend = forecasts.bend(filter_.weights(5, 0.0), 5, 0.0)
    usual = bend.position(mean, 1.0, USUAL_RAD)
    assert np.array_equal(bend.position(mean, 1.0, None), usual)
    assert np.max(np.abs(bend.position(mean, 1.0, USUAL_RAD + SPREAD_RAD) - usual)) > 1e-4
    still = bend._replace(reach=replace(reach, gripper_spread_rad=0.0))
    assert np.array_equal(still.position(mean, 1.0, USUAL_RAD + SPREAD_RAD), usual)
    assert np.array_equal(openness(np.array([1.0, 2.0]), 1.0, 0.0), np.zeros(2))


def test_without_lag_the_arm_is_where_it_was_seen() -> None:
    filter_ = build_innovations_filter(slow_movement(), HORIZON)
    _, forecasts = bent(filter_)
    mean = np.random.default_rng(1).normal(size=len(filter_.one_step))
    assert forecasts.bend(filter_.weights(0, 0.0), 0, 0.0).position(mean, 1.0, None) == pytest.approx(mean[-AXES:])


def test_within_the_first_sample_the_forecast_is_linear_as_truth_is() -> None:
    filter_ = build_innovations_filter(slow_movement(), HORIZON)
    _, forecasts = bent(filter_)
    mean = 1e-3 * np.random.default_rng(4).normal(size=len(filter_.one_step))
    at = {
        fraction: forecasts.bend(filter_.weights(0, fraction), 0, fraction).position(mean, 1.0, None)
        for fraction in (0.0, 0.3, 1.0)
    }
    assert at[0.3] == pytest.approx(0.7 * at[0.0] + 0.3 * at[1.0])


def test_no_direction_is_preferred_and_no_size() -> None:
    """A movement that is turned, and larger by its activity, is forecast turned and larger."""
    filter_ = build_innovations_filter(slow_movement(), HORIZON)
    _, forecasts = bent(filter_)
    rng = np.random.default_rng(2)
    turn, mean = np.linalg.qr(rng.normal(size=(3, 3)))[0], 1e-3 * rng.normal(size=len(filter_.one_step))
    bend = forecasts.bend(filter_.weights(7, 0.5), 7, 0.5)
    one = bend.position(mean, 1.0, None)
    other = bend.position(3.0 * (mean.reshape(-1, AXES) @ turn.T).ravel(), 9.0, None)
    assert other == pytest.approx(3.0 * turn @ one)


def test_the_terms_tell_speed_and_braking_apart() -> None:
    along = np.array([[1.0, 0.0, 0.0]])
    for factor, braking in ((0.5, 1.0), (-0.5, -1.0)):
        phase = Phase(along, factor * along, 0 * along, np.array([np.exp(0.3) - 0.05]))
        (row,) = terms(phase, np.array([0.7]), -2.0, 2.0)
        assert row == pytest.approx([1.0, 0.3, 0.09, braking, 0.3 * braking, 0.09 * braking, 0.7])
    (rest,) = terms(Phase(0 * along, 0 * along, along, np.zeros(1)), np.zeros(1), -2.0, 2.0)
    assert rest == pytest.approx([1.0, -2.0, 4.0, 0.0, 0.0, 0.0, 0.0])


def test_an_estimator_goes_by_it() -> None:
    """Weights of nothing change nothing; others change what is foreseen, and not what was seen."""
    rng, linear = np.random.default_rng(3), movement_model(3)
    y, weights = drawn(linear, 60, rng), rng.normal(size=(len(KNOTS), N_PARTS, N_TERMS))
    found = []
    for scale in (None, 0.0, 1.0):
        reach = None if scale is None else Reach(2, 1e-3, -1.5, 0.5, USUAL_RAD, SPREAD_RAD, KNOTS, scale * weights)
        streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), 100_000_000))
        found.append(play(InnovationsKf(moving_arm(replace(linear, reach=reach))), streams)[20:])
    without, nothing, much = (positions(each) for each in found)
    assert nothing == pytest.approx(without, abs=1e-12)
    assert np.max(np.abs(much - without)) > 1e-5
    for one, other in zip(found[0], found[2], strict=True):
        assert np.array_equal(np.asarray(one.covariance_m2), np.asarray(other.covariance_m2))


def test_the_gripper_counts_at_the_newest_sample_or_the_last_known_one_before() -> None:
    rng, linear = np.random.default_rng(3), movement_model(3)
    y, weights = drawn(linear, 60, rng), rng.normal(size=(len(KNOTS), N_PARTS, N_TERMS))
    reach = Reach(2, 1e-3, -1.5, 0.5, USUAL_RAD, SPREAD_RAD, KNOTS, weights)
    estimator = InnovationsKf(moving_arm(replace(linear, reach=reach)))
    found = {}
    for name, angles in (("none", None), ("usual", np.full(60, USUAL_RAD)), ("opens", np.arange(60.0) - 30.0)):
        streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), 100_000_000), angles)
        found[name] = positions(play(estimator, streams))[20:]
    assert np.array_equal(found["none"], found["usual"])
    assert np.all(np.any(found["none"] != found["opens"], axis=1))


def test_a_hand_at_rest_stays_finite() -> None:
    filter_ = build_innovations_filter(slow_movement(), HORIZON)
    _, forecasts = bent(filter_)
    mean = np.zeros(len(filter_.one_step))
    bend = forecasts.bend(filter_.weights(3, 0.0), 3, 0.0)
    assert np.array_equal(bend.position(mean, 0.0, None), np.zeros(3))
