"""What is found of reaches: against least squares, on reaches, and where there are none."""

from dataclasses import replace

import numpy as np
import pytest

from common.scenario.source import SyntheticSource
from common.sources.synthetic import synthesise
from patient_side.estimators.innovations_kf import InnovationsKf
from patient_side.filters.innovations_filter import build_innovations_filter
from patient_side.filters.reach import N_PARTS, N_TERMS
from patient_side.identification.fit_innovations import fit_innovations
from patient_side.identification.fit_reach import _Moments, _moments, _regress, _Rows, fit_reach
from patient_side.statespace import Array, InnovationsModel
from tests.patient_side.arm_models import (
    LOST,
    Streams,
    delayed,
    play,
    positions,
    ratio_to_hold,
    slow_movement,
    truth_at_ticks,
)
from tests.patient_side.identification.test_fit_innovations import RATE_HZ, returning, trials_of
from tests.patient_side.movements import drawn, moving_arm

MS = 1_000_000
PRIOR = np.full(N_TERMS, 0.3)


def reaching(seed: int, n_rows: int) -> Array:
    """A hand that makes one minimum-jerk reach after another."""
    (hand,) = synthesise(SyntheticSource(kind="synthetic", hands=("left",)), seed, RATE_HZ, n_rows, 0).hands
    return hand.follower.position_m


def error_over_linear(model: InnovationsModel, y: Array, delay_ms: int) -> float:
    streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), delay_ms * MS))
    scored, truth = slice(100, -1), truth_at_ticks(y)
    bent, linear = (
        positions(play(InnovationsKf(moving_arm(each)), streams)) for each in (model, replace(model, reach=None))
    )
    return ratio_to_hold(bent[scored], linear[scored], truth[scored])


def some_rows(seed: int) -> _Rows:
    rng = np.random.default_rng(seed)
    return _Rows(rng.normal(size=(60, N_PARTS, 3)), rng.normal(size=(60, N_TERMS)), rng.normal(size=(60, 3)), 0.7)


def test_it_is_least_squares_with_the_prior_as_rows() -> None:
    rows, n_alike = some_rows(0), 7.0
    prior = np.array([0.3] * (N_TERMS - 1) + [0.1])
    regressors = np.einsum("mia,mt->mait", rows.parts, rows.terms).reshape(180, -1)
    deviation = np.sqrt(np.mean(rows.left**2))
    sizes = np.sqrt(np.mean(regressors**2, axis=0)) / deviation
    stacked = np.vstack([regressors / (deviation * np.sqrt(n_alike)), np.diag(sizes / np.tile(prior, N_PARTS))])
    wanted = np.concatenate([rows.left.ravel() / (deviation * np.sqrt(n_alike)), np.zeros(len(sizes))])
    expected = np.linalg.lstsq(stacked, wanted)[0].reshape(N_PARTS, N_TERMS)
    assert _moments(rows).coefficients(n_alike, prior) == pytest.approx(expected, rel=1e-9)


def test_without_a_block_is_as_if_it_had_not_been() -> None:
    one, other = _moments(some_rows(1)), _moments(some_rows(2))
    both = _Moments(one.past + other.past, one.cross + other.cross, one.square + other.square, one.n + other.n)
    assert both.less(other).coefficients(3.0, PRIOR) == pytest.approx(one.coefficients(3.0, PRIOR), rel=1e-6)
    assert np.array_equal(one.less(one).coefficients(3.0, PRIOR), np.zeros((N_PARTS, N_TERMS)))


def test_of_reaches_it_forecasts_better_than_any_linear_model_of_them() -> None:
    model = fit_innovations(trials_of(*(reaching(seed, 1500) for seed in (1, 2, 3))), RATE_HZ, 10, order=15).model
    assert model.reach is not None
    for seed, delay_ms in ((4, 200), (5, 500)):
        assert error_over_linear(model, reaching(seed, 1800), delay_ms) < 0.98


def test_where_there_are_no_reaches_next_to_nothing_is_found() -> None:
    rng = np.random.default_rng(0)
    model = fit_innovations(trials_of(*(drawn(returning(), 1240, rng) for _ in range(2))), RATE_HZ, 10, order=6).model
    assert model.reach is not None
    fresh = drawn(returning(), 2400, rng)
    for delay_ms in (100, 500):
        assert error_over_linear(model, fresh, delay_ms) < 1.015


def stopping(seed: int, n_rows: int) -> tuple[Array, Array]:
    """A movement whose velocity decays sooner where the gripper is closed, and the gripper's angle."""
    rng = np.random.default_rng(seed)
    angle = np.repeat(np.where(rng.random(n_rows // 10 + 1) < 0.5, 1.2, -0.3), 10)[:n_rows]
    y, v = np.zeros((n_rows, 3)), np.zeros(3)
    for k in range(1, n_rows):
        v = (0.95 if angle[k - 1] > 0 else 0.6) * v + 1e-4 * rng.normal(size=3)
        y[k] = y[k - 1] + v
    return y, angle


def test_what_an_open_gripper_means_is_found_and_one_that_means_nothing_does_no_harm() -> None:
    """Of the same movement: with the angle that decides, with another's, and without any."""
    trials, chance = [stopping(seed, 1500) for seed in (1, 2, 3)], [stopping(seed, 1500)[1] for seed in (7, 8, 9)]
    moves = trials_of(*(y for y, _ in trials))
    y, angle = stopping(4, 3000)
    streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), 200 * MS), angle)
    scored, truth, errors = slice(100, -1), truth_at_ticks(y), {}
    for name, angles in (("deciding", [g for _, g in trials]), ("chance", chance), ("none", [])):
        model = fit_innovations(moves, RATE_HZ, 10, order=6, grippers_rad=angles).model
        assert model.reach is not None
        assert (model.reach.gripper_spread_rad > 0) == (name != "none")
        errors[name] = positions(play(InnovationsKf(moving_arm(model)), streams))[scored] - truth[scored]
    size = {name: float(np.sqrt(np.mean(error**2))) for name, error in errors.items()}
    assert size["deciding"] < 0.98 * size["none"]
    assert size["chance"] < 1.005 * size["none"]


def test_errors_are_of_coefficients_that_have_not_seen_them() -> None:
    """Of noise, coefficients explain some of what they have seen, and less than nothing of the rest."""
    rows = some_rows(3)
    coefficients, (errors,) = _regress([rows], 1.0, PRIOR, 6)
    before, seen, unseen = (float(np.sum(each**2)) for each in (rows.left, rows.without(coefficients), errors))
    assert seen < 0.95 * before
    assert unseen > before


def test_rows_too_few_for_a_horizon_leave_it_linear() -> None:
    y, filter_ = np.random.default_rng(2).normal(size=(3, 3)), build_innovations_filter(slow_movement(), 10)
    means = np.zeros((3, len(filter_.one_step)))
    fitted = fit_reach([y], [means], [np.ones(3)], [1.0], filter_, np.array([1, 5]), RATE_HZ)
    assert np.array_equal(fitted.reach.weights[1], np.zeros((N_PARTS, N_TERMS)))
    assert len(fitted.errors[1][0]) == 0
