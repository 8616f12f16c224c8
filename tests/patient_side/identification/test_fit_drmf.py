import numpy as np
import pytest

from tests.models_once import judge_by_few_draws
from tests.patient_side.arm_models import (
    LOST,
    RATE_HZ,
    Streams,
    delayed,
    inside_95,
    play,
    random_command,
    truth_at_ticks,
)
from tis.common.errors import DataError
from tis.patient_side.estimators.drmf import Drmf
from tis.patient_side.identification.fit_drmf import fit_drmf
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import CompletionModel
from tis.patient_side.playout import Playout


def movement(n_rows: int, seed: int) -> Array:
    return random_command(np.random.default_rng(seed), n_rows, 0.9, 1e-4)


def waves(n_rows: int, seed: int) -> Array:
    """Two sinusoids of drawn phases, the same frequencies in every trial, and noise of 10 um."""
    rng = np.random.default_rng(seed)
    t, phases = np.arange(n_rows)[:, None], rng.uniform(0, 6, (2, 3))
    return np.asarray(
        0.01 * np.sin(0.2 * t + phases[0]) + 0.005 * np.sin(0.7 * t + phases[1]) + 1e-5 * rng.normal(size=(n_rows, 3))
    )


def errors(model: CompletionModel, y: Array, steps: int) -> tuple[float, float]:
    """Root mean square errors of the model's estimator and of hold, ``steps`` ahead, on every third row."""
    estimator, missed, held = Drmf(model), [], []
    for row in range(120, len(y) - steps, 3):
        playout = Playout(RATE_HZ)
        for index in range(row - 110, row + 1):
            playout.arm.add(index, y[index])
        _, estimate = estimator.step(None, playout, -(-(row + steps) * 10**9 // RATE_HZ))
        assert estimate.position_m is not None
        missed.append(estimate.position_m - y[row + steps])
        held.append(y[row] - y[row + steps])
    return float(np.sqrt(np.mean(np.square(missed)))), float(np.sqrt(np.mean(np.square(held))))


def test_a_movement_of_known_rank_is_forecast_to_its_noise(few_draws: None) -> None:
    model = fit_drmf([waves(500, seed) for seed in range(3)], RATE_HZ)
    missed, held = errors(model, waves(400, 9), 6)
    assert held > 5e-3
    assert missed < 5e-5


@pytest.fixture(scope="module")
def of_decaying_velocities() -> CompletionModel:
    return fit_drmf([movement(1500, seed) for seed in range(4)], RATE_HZ)


def test_of_a_velocity_that_decays_the_error_is_near_the_least(of_decaying_velocities: CompletionModel) -> None:
    missed, _ = errors(of_decaying_velocities, movement(600, 50), 3)
    # The best forecast errs by the noises of three steps: the sums of powers 1; 1, 0.9; 1, 0.9, 0.81.
    least = 1e-4 * np.sqrt(1.0**2 + 1.9**2 + 2.71**2)
    assert missed < 1.1 * least


def test_ellipsoids_cover_what_they_say(of_decaying_velocities: CompletionModel) -> None:
    estimator = Drmf(of_decaying_velocities)
    inside: list[bool] = []
    for seed in range(2):
        y = movement(600, 60 + seed)
        lost = np.random.default_rng(seed).random(len(y)) < 0.2
        arrivals = [LOST if lost[i] else t for i, t in enumerate(delayed(len(y), 150_000_000))]
        estimates = play(estimator, Streams(y, y, [LOST] * len(y), arrivals))
        inside += inside_95(estimates[120:-1], truth_at_ticks(y)[120:-1])
    assert 0.90 < np.mean(inside) < 0.99


def test_of_a_random_walk_hold_is_left(few_draws: None) -> None:
    walk = np.cumsum(np.random.default_rng(1).normal(size=(3000, 3)), axis=0) * 1e-4
    missed, held = errors(fit_drmf([walk[:2000]], RATE_HZ), walk[2000:2700], 6)
    assert missed < 1.06 * held


@pytest.fixture
def few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    judge_by_few_draws(monkeypatch)


@pytest.fixture(scope="module")
def of_two_trials() -> CompletionModel:
    with pytest.MonkeyPatch.context() as patch:
        judge_by_few_draws(patch)
        return fit_drmf([movement(300, 1), movement(900, 2)], RATE_HZ)


def test_moves_are_mean_squares_per_axis_of_all_trials(of_two_trials: CompletionModel) -> None:
    trials, model = [movement(300, 1), movement(900, 2)], of_two_trials
    for steps in (0, 1, 7, len(model.moves_m2) - 1):
        moves = np.concatenate([y[steps:] - y[: len(y) - steps] for y in trials])
        assert model.moves_m2[steps] == pytest.approx(np.mean(moves**2), abs=1e-18)


def test_at_a_higher_rate_a_step_is_a_30th_of_a_second(few_draws: None) -> None:
    y = movement(2400, 3)
    model = fit_drmf([y], 240)
    assert model.stride == 8
    every_eighth = y[::8]
    assert model.moves_m2[2] == pytest.approx(np.mean((every_eighth[2:] - every_eighth[:-2]) ** 2), abs=1e-18)


def test_errors_grow_with_the_horizon(of_two_trials: CompletionModel) -> None:
    model = of_two_trials
    spreads = np.trace(model.covariance_m2, axis1=1, axis2=2)
    assert np.all(np.diff(np.log(spreads[[0, 2, 4, 6]])) > 0)
    assert np.all(np.linalg.eigvalsh(model.covariance_m2) > 0)


def test_an_arm_that_never_moved_is_held(few_draws: None) -> None:
    model = fit_drmf([np.full((200, 3), 0.05)], RATE_HZ)
    playout, y = Playout(RATE_HZ), movement(100, 4)
    for index in range(90):
        playout.arm.add(index, y[index])
    _, estimate = Drmf(model).step(None, playout, 93 * 10**9 // RATE_HZ)
    assert estimate.position_m is not None
    assert np.abs(estimate.position_m - y[89]).max() < np.ptp(y, axis=0).max()
    assert np.linalg.eigvalsh(model.covariance_m2).min() > 0


def test_people_are_held_out_together(few_draws: None) -> None:
    # Of each person a rhythm of their own: what helps within a person does not help with another.
    t = np.arange(300)[:, None]
    trials = [0.01 * np.sin(rate * t + [0.0, 1.0, 2.0] + phase) for rate in (0.05, 0.4, 1.1) for phase in (0.0, 1.5)]
    alone = fit_drmf(trials, RATE_HZ)
    apart = fit_drmf(trials, RATE_HZ, ["a", "a", "b", "b", "c", "c"])
    assert np.trace(apart.covariance_m2[0]) > 4 * np.trace(alone.covariance_m2[0])
    assert alone.moves_m2[:10] == pytest.approx(apart.moves_m2[:10])


def test_too_few_rows_are_refused_and_few_are_enough(few_draws: None) -> None:
    with pytest.raises(DataError, match="drmf needs 32 rows in one trial"):
        fit_drmf([movement(31, 0)], RATE_HZ)
    with pytest.raises(DataError, match="drmf needs 256 rows in one trial"):
        fit_drmf([movement(248, 0)], 240)
    model = fit_drmf([movement(32, 0)], RATE_HZ)
    assert np.isfinite(model.covariance_m2).all()


def test_the_same_rows_give_the_same_model_and_are_not_modified(
    few_draws: None, of_two_trials: CompletionModel
) -> None:
    trials = [movement(300, 1), movement(900, 2)]
    for y in trials:
        y.flags.writeable = False
    model = fit_drmf(trials, RATE_HZ)
    assert model.factorisation == of_two_trials.factorisation
    assert np.array_equal(model.covariance_m2, of_two_trials.covariance_m2)
