"""What is found beyond a linear model: against least squares, on reaches, and where there is nothing."""

from dataclasses import replace

import numpy as np
import pytest

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
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.filters.activity import ActivityMean
from tis.patient_side.filters.innovations_filter import InnovationsFilter, build_innovations_filter
from tis.patient_side.filters.recent_past import RecentPast
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.identification.correction_rows import CorrectionRows
from tis.patient_side.identification.fit_correction import Moments, fit_correction, solutions
from tis.patient_side.identification.fit_innovations import fit_innovations
from tis.patient_side.identification.level_and_scale import HeldBack
from tis.patient_side.identification.trials import held_out_groups
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_PARTS, N_TERMS, InnovationsModel

MS = 1_000_000
STEPS = np.array([1, 2, 5])


def reaching(seed: int, n_rows: int) -> Array:
    """A hand that makes one minimum-jerk reach after another."""
    (hand,) = synthesise(SyntheticSource(kind="synthetic", hands=("left",)), seed, RATE_HZ, n_rows, 0).hands
    return hand.follower.position_m


def over_linear(model: InnovationsModel, y: Array, delay_ms: int, angle: Array | None = None) -> float:
    """Return the rms error over that of the same model without its correction."""
    streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), delay_ms * MS), angle)
    scored, truth = slice(100, -1), truth_at_ticks(y)
    corrected, linear = (
        positions(play(InnovationsKf(moving_arm(each)), streams)) for each in (model, replace(model, correction=None))
    )
    return ratio_to_hold(corrected[scored], linear[scored], truth[scored])


def rows_of(model: InnovationsModel, *outputs: Array) -> tuple[list[CorrectionRows], InnovationsFilter]:
    filter_ = build_innovations_filter(model, 10, past=RecentPast.at_rate(RATE_HZ))
    held = HeldBack(outputs, (0,) * len(outputs))
    means, activities = held.run(filter_, Unbroken.of(filter_, 500), ActivityMean.at_rate(RATE_HZ))
    groups = held_out_groups([len(y) for y in outputs], [])
    return [
        CorrectionRows(y, mean, activity, np.zeros(len(y)), group)
        for y, mean, activity, group in zip(outputs, means, activities, groups, strict=True)
    ], filter_


def some_moments(seed: int) -> tuple[Moments, Array, Array]:
    rng = np.random.default_rng(seed)
    regressors, errors = rng.normal(size=(60, 5)) * [1, 2, 3, 4, 1e-3], rng.normal(size=(60, 2))
    moments = Moments(
        (regressors.T @ regressors)[None],
        (regressors.T @ errors)[None],
        np.array([float(np.sum(errors**2))]),
        np.array([60.0]),
    )
    return moments, regressors, errors


def test_it_is_least_squares_with_the_prior_as_rows() -> None:
    moments, regressors, errors = some_moments(0)
    precision = np.array([7.0, 3.0, 5.0, 1.0, 2.0])
    found, (without,) = solutions(moments, precision)
    # A coefficient of 1 / sqrt(precision), in deviations, is as likely as one row's error.
    deviation = np.sqrt(np.sum(errors**2) / 60)
    sizes = np.sqrt(np.sum(regressors**2, axis=0) / 60)
    stacked = np.vstack([regressors, np.diag(sizes * np.sqrt(precision))])
    expected = np.linalg.lstsq(stacked, np.vstack([errors, np.zeros((5, 2))]))[0]
    assert deviation > 0
    assert found == pytest.approx(expected, rel=1e-9)
    # Without the only group there is nothing to go by.
    assert np.array_equal(without, np.zeros((5, 2)))


def test_without_a_group_is_as_if_it_had_not_been() -> None:
    one, other = some_moments(1)[0], some_moments(2)[0]
    both = Moments(*(np.concatenate(pair) for pair in zip(one, other, strict=True)))
    precision = np.full(5, 3.0)
    _, (without_one, without_other) = solutions(both, precision)
    assert without_other == pytest.approx(solutions(one, precision)[0], rel=1e-6)
    assert without_one == pytest.approx(solutions(other, precision)[0], rel=1e-6)


def test_of_reaches_it_forecasts_better_than_any_linear_model_of_them() -> None:
    model = fit_innovations(trials_of(*(reaching(seed, 1500) for seed in (1, 2, 3))), RATE_HZ, 10, order=15).model
    for seed, delay_ms in ((4, 200), (5, 500)):
        assert over_linear(model, reaching(seed, 1800), delay_ms) < 0.98


def test_where_there_are_no_reaches_next_to_nothing_is_found() -> None:
    rng = np.random.default_rng(0)
    model = fit_innovations(trials_of(*(drawn(returning(), 1240, rng) for _ in range(2))), RATE_HZ, 10, order=6).model
    assert model.correction is not None
    assert model.correction.clock == 0.0
    fresh = drawn(returning(), 2400, rng)
    for delay_ms in (33, 100, 500):
        assert over_linear(model, fresh, delay_ms) < 1.015


def picked(y: Array, ratio: float, offset: float) -> Array:
    """Rows that hold the newest sample of a source of ``ratio`` samples per row."""
    return np.asarray(y[np.floor(np.arange(int(len(y) / ratio) - 1) * ratio + offset).astype(int)])


def test_rows_of_an_uneven_clock_are_foreseen_by_its_phase() -> None:
    """With every second or third sample left out, the phase is still known."""
    rng, ratio = np.random.default_rng(1), 1.71
    trials = [picked(drawn(returning(), 3000, rng), ratio, offset) for offset in (0.1, 0.5, 0.9)]
    model = fit_innovations(trials_of(*trials), RATE_HZ, 10, order=12).model
    assert model.correction is not None
    assert model.correction.clock == pytest.approx(2 - ratio, abs=1e-3)
    fresh = picked(drawn(returning(), 4000, rng), ratio, 0.3)
    assert over_linear(model, fresh, 33) < 0.9
    even = drawn(returning(), 2000, rng)
    assert over_linear(model, even, 33) < 1.1


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
    scored, truth, size = slice(100, -1), truth_at_ticks(y), {}
    for name, angles in (("deciding", [g for _, g in trials]), ("chance", chance), ("none", [])):
        model = fit_innovations(moves, RATE_HZ, 10, order=6, grippers_rad=angles).model
        assert model.correction is not None
        assert (model.correction.gripper_spread_rad > 0) == (name != "none")
        error = positions(play(InnovationsKf(moving_arm(model)), streams))[scored] - truth[scored]
        size[name] = float(np.sqrt(np.mean(error**2)))
    assert size["deciding"] < 0.98 * size["none"]
    assert size["chance"] < 1.005 * size["none"]


def test_the_same_rows_give_the_same_correction() -> None:
    y = reaching(1, 900)
    one, other = (fit_innovations(trials_of(each), RATE_HZ, 10, order=6).model.correction for each in (y, y.copy()))
    assert one is not None
    assert other is not None
    for name, value in vars(one).items():
        assert np.array_equal(value, getattr(other, name)), name


def test_of_noise_nothing_is_kept_and_the_errors_are_those_of_rows_held_out() -> None:
    rng = np.random.default_rng(4)
    rows, filter_ = rows_of(slow_movement(), *(drawn(slow_movement(), 200, rng) for _ in range(2)))
    fitted = fit_correction(rows, filter_, STEPS, RATE_HZ)
    for held_out, linear in zip(fitted.errors, fitted.linear_errors, strict=True):
        after, before = (float(np.sum(np.concatenate(each) ** 2)) for each in (held_out, linear))
        assert 0.95 * before < after <= 1.001 * before


def test_rows_too_few_for_a_horizon_leave_it_linear() -> None:
    rows, filter_ = rows_of(slow_movement(), np.random.default_rng(2).normal(size=(3, 3)))
    fitted = fit_correction(rows, filter_, STEPS, RATE_HZ)
    assert np.array_equal(fitted.correction.weights[2], np.zeros((N_PARTS, N_TERMS)))
    assert len(fitted.errors[2][0]) == 0
