"""What is found of known movements, and of real ones where they are."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import chdtri

from tests.patient_side.arm_models import LOST, Streams, delayed, play, positions, ratio_to_hold, truth_at_ticks
from tests.patient_side.identification.known_systems import hand_like, real_recording
from tests.patient_side.movements import drawn, movement_model, moving_arm
from tis.common.errors import DataError
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.filters.activity import ActivityMean
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.identification.coverage import independent_windows, prediction_factor
from tis.patient_side.identification.fit_innovations import FittedInnovations, fit_innovations
from tis.patient_side.identification.level_and_scale import (
    HeldBack,
    clearly_better,
    error_over_hold,
    try_model,
    with_scale,
)
from tis.patient_side.identification.structure import Structure
from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel

RATE_HZ = 30
HORIZONS = [1, 3, 6]


def trials_of(*outputs: Array) -> list[Trial]:
    return [(y[:, :0], y) for y in outputs]


def structure_of(fitted: FittedInnovations) -> Structure:
    return Structure(isotropic=fitted.model.isotropic, integrated=fitted.model.integrated)


def error_of(model: InnovationsModel, y: Array, horizons: Sequence[int] = HORIZONS) -> float:
    filter_ = build_innovations_filter(model, max(30, *horizons))
    return error_over_hold(HeldBack((y,), (60,)), filter_, Unbroken.of(filter_, len(y)), horizons)


def returning() -> InnovationsModel:
    """A movement that comes back to its level within seconds."""
    eye, none = np.eye(3), np.zeros((3, 3))
    A = np.block([[1.90 * eye, -0.905 * eye], [eye, none]])
    model = movement_model(3, level_step=0.02)
    return replace(model, A=A, C=np.hstack([eye, none]), K=np.vstack([1.85 * eye, 0.95 * eye]))


def going_on() -> InnovationsModel:
    eye = np.eye(3)
    return replace(movement_model(3, integrated=True), A=0.9 * eye, C=eye, K=0.85 * eye)


@pytest.mark.parametrize("known", [returning(), going_on()])
def test_it_forecasts_fresh_rows_nearly_as_well_as_the_true_model(known: InnovationsModel) -> None:
    rng = np.random.default_rng(0)
    fitted = fit_innovations(trials_of(*(drawn(known, 1500, rng) for _ in range(3))), RATE_HZ, 10)
    assert structure_of(fitted) == Structure(isotropic=True, integrated=False)
    fresh = drawn(known, 2000, rng)
    assert error_of(fitted.model, fresh) < 1.02 * error_of(known, fresh)
    steps = fitted.model.scale_horizons
    by_chance = [prediction_factor(independent_windows(3 * (1440 - h), h), fitted.model.order / 3) for h in steps]
    scale = fitted.model.covariance_scale / by_chance
    assert np.all((scale > 0.8) & (scale < 1.5))
    assert fitted.warnings == ()
    for delay_ms in (33, 200, 1000):
        streams = Streams(np.zeros_like(fresh), fresh, [LOST] * len(fresh), delayed(len(fresh), delay_ms * 1_000_000))
        said = play(InnovationsKf(moving_arm(fitted.model)), streams)[60:-1]
        missed = positions(said) - truth_at_ticks(fresh)[60:-1]
        squares = [e @ np.linalg.solve(np.asarray(s.covariance_m2), e) for s, e in zip(said, missed, strict=True)]
        assert 0.90 < np.mean(np.array(squares) < chdtri(3, 0.05)) < 0.98


def test_where_trials_wander_off_what_is_clearly_better_is_taken() -> None:
    """What a short trial cannot tell, the preference decides; it must not cost much, up to 5 s."""
    rng = np.random.default_rng(1)
    fitted = fit_innovations(trials_of(*(drawn(going_on(), 1500, rng) for _ in range(3))), RATE_HZ, 10)
    fresh = drawn(going_on(), 3000, rng)
    for horizons in ([15, 30], [60, 90], [150]):
        assert error_of(fitted.model, fresh, horizons) < 1.05 * error_of(going_on(), fresh, horizons)


def test_directions_that_move_differently_are_told_apart() -> None:
    """One axis swings, one goes on and the third drags it along: no one movement is that of all."""
    rng = np.random.default_rng(2)
    A = np.array([[0.95, 0.0, 0.0], [0.3, -0.6, 0.0], [0.0, 0.0, 0.3]])
    known = replace(movement_model(3), A=A, C=np.eye(3), K=0.9 * A)
    fitted = fit_innovations(trials_of(*(drawn(known, 1500, rng) for _ in range(3))), RATE_HZ, 10)
    assert not structure_of(fitted).isotropic
    fresh = drawn(known, 2000, rng)
    assert error_of(fitted.model, fresh) < 1.03 * error_of(known, fresh)


def test_one_movement_in_every_direction_forecasts_alike_in_every_frame() -> None:
    rng = np.random.default_rng(3)
    y = drawn(returning(), 1240, rng)
    turned = y @ np.linalg.qr(rng.normal(size=(3, 3)))[0]
    one, other = (fit_innovations(trials_of(each), RATE_HZ, 10).model for each in (y, turned))
    assert one.isotropic
    assert other.isotropic
    fresh = drawn(returning(), 1000, rng)
    assert error_of(one, fresh) == pytest.approx(error_of(other, fresh), rel=0.01)


def test_a_lively_trial_does_not_outvote_the_others() -> None:
    """Two movements of one kind and a third, of another, that is fifty times as large: the model is of the two."""
    rng, other = np.random.default_rng(2), replace(going_on(), A=-0.5 * np.eye(3), K=-0.4 * np.eye(3))
    calm = [drawn(going_on(), 900, rng) for _ in range(4)]
    fitted = fit_innovations(trials_of(*calm, 50 * drawn(other, 900, rng)), RATE_HZ, 10)
    alone = fit_innovations(trials_of(*calm), RATE_HZ, 10)
    fresh = drawn(going_on(), 2000, rng)
    assert error_of(fitted.model, fresh) < 1.15 * error_of(alone.model, fresh)


def test_the_innovations_are_as_large_as_they_are_on_average() -> None:
    rng, known = np.random.default_rng(3), going_on()
    outputs = [scale * drawn(known, 1500, rng) for scale in (1.0, 1.0, 3.0)]
    fitted = fit_innovations(trials_of(*outputs), RATE_HZ, 10)
    expected = np.trace(known.Re) * (1 + 1 + 9) / 3
    assert np.trace(fitted.model.Re) == pytest.approx(expected, rel=0.15)


def test_the_order_is_the_smallest_that_suffices_or_the_given_one() -> None:
    y = drawn(going_on(), 1500, np.random.default_rng(4))
    fitted = fit_innovations(trials_of(y), RATE_HZ, 10)
    errors = fitted.errors[structure_of(fitted)]
    assert fitted.model.order == min(n for n, e in errors.items() if e <= 1.003 * min(errors.values()))
    assert fit_innovations(trials_of(y), RATE_HZ, 10, order=5).model.order == 5
    with pytest.raises(DataError, match=r"1\.\.27"):
        fit_innovations(trials_of(y), RATE_HZ, 10, order=28)


def test_inputs_play_no_part_and_nothing_is_modified() -> None:
    y = hand_like(600, 1)
    before = y.copy()
    one = fit_innovations([(hand_like(600, 2), y)], RATE_HZ, 8).model
    other = fit_innovations(trials_of(y), RATE_HZ, 8).model
    assert np.array_equal(one.A, other.A)
    assert np.array_equal(one.covariance_scale, other.covariance_scale)
    assert np.array_equal(y, before)


@pytest.mark.parametrize("n_rows", [20, 78])
def test_too_few_rows_are_refused_with_the_number(n_rows: int) -> None:
    with pytest.raises(DataError, match=rf"got {n_rows}"):
        fit_innovations(trials_of(hand_like(n_rows, 1)), RATE_HZ, 10)


def test_heavy_tails_ask_for_wider_covariances() -> None:
    rng, known = np.random.default_rng(5), going_on()
    y = drawn(known, 3000, rng)
    bursts = np.cumsum(np.diff(y, axis=0, prepend=y[:1]) * (1 + 4 * (rng.random((3000, 1)) < 0.05)), axis=0)
    held = [HeldBack((signal,), (60,)) for signal in (y, bursts)]
    scales = [with_scale(known, each, RATE_HZ).model.covariance_scale for each in held]
    assert scales[0][0] == pytest.approx(1.0, abs=0.12)
    assert scales[1][0] > 1.2 * scales[0][0]
    assert ActivityMean.at_rate(RATE_HZ).first == 60.0


def test_better_has_to_be_more_than_chance() -> None:
    rng, known = np.random.default_rng(6), going_on()
    held_back = HeldBack((drawn(known, 3000, rng),), (2000,))
    true = try_model(known, held_back, RATE_HZ)
    wrong = try_model(replace(known, K=0.3 * known.K), held_back, RATE_HZ)
    hardly = try_model(replace(known, K=0.999 * known.K), held_back, RATE_HZ)
    assert clearly_better(true, wrong, held_back, RATE_HZ)
    assert not clearly_better(wrong, true, held_back, RATE_HZ)
    assert not clearly_better(true, hardly, held_back, RATE_HZ)
    assert not clearly_better(true, true, held_back, RATE_HZ)


@pytest.mark.parametrize(("delay_ms", "bound"), [(33, 0.41), (100, 0.41), (200, 0.55), (500, 0.83), (1000, 0.95)])
def test_a_real_trial_after_training_on_others(
    others_model: tuple[InnovationsModel, Array], delay_ms: int, bound: float
) -> None:
    model, y = others_model
    streams = Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), delay_ms * 1_000_000))
    estimates, scored = play(InnovationsKf(moving_arm(model)), streams), slice(100, -1)
    truth = truth_at_ticks(y)[scored]
    hold = np.array([y[max(0, int((k + 0.06) - delay_ms * RATE_HZ / 1000))] for k in range(len(y))])[scored]
    assert ratio_to_hold(positions(estimates)[scored], hold, truth) < bound
    errors = positions(estimates)[scored] - truth
    inside = [
        e @ np.linalg.solve(np.asarray(said.covariance_m2), e) < 7.815
        for e, said in zip(errors, estimates[scored], strict=True)
    ]
    assert 0.86 < np.mean(inside) < 0.985


@pytest.fixture(scope="module")
def others_model(jigsaws_dir: Path) -> tuple[InnovationsModel, Array]:
    """A model of both arms of three subjects, and the right arm of a fourth."""
    others = [real_recording(jigsaws_dir, f"Suturing_{name}") for name in ("C004", "E003", "F003")]
    outputs = [hand.follower.position_m for recording in others for hand in recording.hands]
    own = real_recording(jigsaws_dir, "Suturing_D002").hands[1].follower.position_m
    return fit_innovations(trials_of(*outputs), RATE_HZ, 10).model, own
