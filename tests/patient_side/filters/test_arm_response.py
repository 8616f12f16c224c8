"""An arm behind its command as states of the filter: the regression itself, and conditioning on what is seen."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.arm_models import RATE_HZ
from tests.patient_side.movements import drawn, movement_model
from tis.patient_side.filters.innovations_filter import (
    ARM,
    BOTH,
    COMMAND,
    InnovationsFilter,
    build_innovations_filter,
    correct,
)
from tis.patient_side.filters.recent_past import RecentPast
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import ArmResponse, InnovationsModel

RESPONSE = ArmResponse(np.eye(3), np.array([0.9, -0.3, 0.1, 0.0]), np.array([0.05, 0.1, 0.1, 0.03, 0.02]), 0.01)
PULLED = replace(RESPONSE, pull=0.1, drift=0.02)
NOISY = replace(RESPONSE, error=4.0)
OFFSET_M = 0.01


def isotropic(*, integrated: bool, response: ArmResponse = RESPONSE) -> InnovationsModel:
    eye, none = np.eye(3), np.zeros((3, 3))
    model = movement_model(3, integrated=integrated)
    if integrated:
        return replace(model, A=0.9 * eye, C=eye, K=0.8 * eye, Re=1e-8 * eye, response=response)
    A = np.block([[1.6 * eye, -0.65 * eye], [eye, none]])
    C, K = np.hstack([eye, none]), np.vstack([1.5 * eye, 0.9 * eye])
    return replace(model, A=A, C=C, K=K, Re=1e-8 * eye, response=response)


def followed(p: Array, rng: np.random.Generator, deviation_m: float = 0.0, response: ArmResponse = RESPONSE) -> Array:
    dp, y = np.diff(p, axis=0), [p[0].copy() + OFFSET_M]
    dy: list[Array] = []
    for k in range(len(dp)):
        move = deviation_m * rng.normal(size=3)
        move += response.pull * (p[k] + OFFSET_M - y[k])
        for i, weight in enumerate(response.command):
            move += weight * (dp[k - i] if k >= i else 0.0)
        for i, weight in enumerate(response.own):
            move += weight * (dy[k - 1 - i] if k > i else 0.0)
        dy.append(move)
        y.append(y[-1] + move)
    return np.array(y)


def built(model: InnovationsModel, *, whole: bool = False) -> InnovationsFilter:
    return build_innovations_filter(model, 20, whole=whole, past=RecentPast.at_rate(RATE_HZ))


def seen(p: Array, y: Array, what: int) -> Array:
    return np.concatenate(([p] if what else []) + ([] if what == COMMAND else [y]))


def run(filter_: InnovationsFilter, p: Array, y: Array, shown: list[int]) -> tuple[Array, Array]:
    mean, covariance = filter_.start(seen(p[0], y[0], BOTH))
    for k, what in enumerate(shown, start=1):
        gain, _, covariance = filter_.gain(covariance, 1, None, what)
        mean = filter_.onward[1].dot(mean)
        correct(mean, gain, seen(p[k], y[k], what), filter_.shown(what))
    return mean, covariance


@pytest.mark.parametrize("response", [RESPONSE, PULLED])
@pytest.mark.parametrize("integrated", [False, True])
def test_the_forecast_is_the_regression_run_on(integrated: bool, response: ArmResponse) -> None:
    rng = np.random.default_rng(3)
    model = isotropic(integrated=integrated, response=response)
    p = drawn(model, 60, rng)
    y = followed(p, rng, response=response)
    filter_ = built(model)
    mean, _ = run(filter_, p, y, [BOTH] * 39)
    ahead = np.array([(filter_.hand(h) @ mean).ravel() for h in range(9)])
    assert ahead[0] == pytest.approx(p[39], abs=1e-12)
    expected = followed(np.vstack([p[:39], ahead]), rng, response=response)[39:]
    found = np.array([(filter_.output(h) @ mean).ravel() for h in range(9)])
    assert found == pytest.approx(expected, abs=1e-11)
    assert filter_.forecasts(mean.reshape(1, -1), 5) == pytest.approx(expected[5:6], abs=1e-11)


@settings(max_examples=20, deadline=None)
@given(
    shown=st.lists(st.sampled_from([ARM, COMMAND, BOTH]), min_size=1, max_size=12),
    seed=st.integers(0, 99),
    response=st.sampled_from([RESPONSE, PULLED, NOISY]),
)
def test_of_one_axis_it_is_what_three_give(shown: list[int], seed: int, response: ArmResponse) -> None:
    rng = np.random.default_rng(seed)
    model = isotropic(integrated=False, response=response)
    p = drawn(model, 40, rng)
    y = followed(p, rng, 1e-5, response)
    (one, of_one), (all_axes, of_all) = (run(built(model, whole=whole), p, y, shown) for whole in (False, True))
    assert all_axes.reshape(one.shape) == pytest.approx(one, abs=1e-9)
    assert of_all == pytest.approx(np.kron(of_one, model.Re), abs=1e-14)


@settings(max_examples=20, deadline=None)
@given(
    shown=st.lists(st.sampled_from([ARM, COMMAND, BOTH]), min_size=1, max_size=12),
    response=st.sampled_from([RESPONSE, PULLED, NOISY]),
)
def test_a_sample_of_each_is_one_of_both(shown: list[int], response: ArmResponse) -> None:
    """The covariance is that of conditioning on all that is shown, in one textbook update after another.

    Only samples of the arm may have errors.
    """
    filter_ = built(isotropic(integrated=True, response=response))
    covariance = np.array(filter_.start_covariance)
    expected = covariance.copy()
    for what in shown:
        _, _, covariance = filter_.gain(np.asfortranarray(covariance), 1, None, what)
        H = np.eye(filter_.n_states)[filter_.shown(what)]
        expected = filter_.transitions[1] @ expected @ filter_.transitions[1].T + filter_.noises[1]
        errors = np.zeros((len(H), len(H)))
        if what != COMMAND:
            errors[-filter_.n_axes :, -filter_.n_axes :] = response.error * np.eye(filter_.n_axes)
        expected -= expected @ H.T @ np.linalg.solve(H @ expected @ H.T + errors, H @ expected)
    assert covariance == pytest.approx(expected, rel=1e-6, abs=1e-9 * np.max(np.abs(expected)))


def test_what_has_not_been_seen_is_believed_at_once() -> None:
    """Neither a guess at the command nor the movement before the first sample moves the arm."""
    rng = np.random.default_rng(5)
    model = isotropic(integrated=False)
    p = drawn(model, 80, rng) + 0.1
    y = followed(p, rng)
    filter_ = built(model)
    truth, _ = run(filter_, p[10:], y[10:], [BOTH] * 30)
    for what in (ARM, COMMAND):
        guess = seen(p[10], y[10], BOTH) + 0.02 * np.array([1, 1, 1, 0, 0, 0] if what == ARM else [0, 0, 0, 1, 1, 1])
        mean, covariance = filter_.start(guess, None, what)
        for k, _ in pairwise(range(10, 41)):
            gain, _, covariance = filter_.gain(covariance, 1)
            mean = filter_.onward[1].dot(mean)
            correct(mean, gain, seen(p[k + 1], y[k + 1], BOTH), filter_.shown(BOTH))
        assert filter_.output(5) @ mean == pytest.approx(filter_.output(5) @ truth, abs=2e-5)
