from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.patient_side.arm_models import (
    LOST,
    RATE_HZ,
    Streams,
    delayed,
    inside_95,
    play,
    positions,
    random_command,
    ratio_to_hold,
    static_model,
    truth_at_ticks,
)
from tests.patient_side.identification.known_systems import real_recording
from tis.common.errors import DataError
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.direct_ls import DirectLs, direct_ls
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.identification.direct_ls import fit_direct, windows
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout

DAMPING, NOISE_M = 0.9, 1e-4


def movement(n_rows: int, seed: int) -> Array:
    return random_command(np.random.default_rng(seed), n_rows, DAMPING, NOISE_M)


def playout_of(y: Array, indices: list[int]) -> Playout:
    playout = Playout(RATE_HZ)
    for index in indices:
        playout.arm.add(index, y[index])
    return playout


@pytest.fixture(scope="module")
def estimator() -> DirectLs:
    return DirectLs(fit_direct([movement(6000, seed) for seed in range(6)], RATE_HZ))


@pytest.mark.parametrize("steps", [1, 3, 10])
def test_of_a_velocity_that_decays_it_forecasts_the_decay_and_its_error(estimator: DirectLs, steps: int) -> None:
    y = movement(200, 50)
    _, estimate = estimator.step(None, playout_of(y, list(range(200))), sample_instant_ns(199 + steps, RATE_HZ))
    powers = DAMPING ** np.arange(steps + 1)
    assert estimate.position_m is not None
    assert estimate.covariance_m2 is not None
    wanted = y[199] + (y[199] - y[198]) * powers[1:].sum()
    std = NOISE_M * np.sqrt(np.sum(np.cumsum(powers[:steps]) ** 2))
    assert estimate.position_m == pytest.approx(wanted, abs=0.15 * std)
    assert np.sqrt(np.diag(estimate.covariance_m2)) == pytest.approx(np.full(3, std), rel=0.15)


def test_missing_samples_give_the_regression_on_those_that_are_there() -> None:
    trials = [movement(700, seed) for seed in range(3)]
    model = fit_direct(trials, RATE_HZ)
    model = replace(model, penalty=np.full_like(model.penalty, 1e-12))
    there = [index for index in range(560, 700) if index % 3 and index not in (690, 691)]
    y = trials[0]
    lags = np.array([lag for lag in model.lags if 699 - lag in there])[: int(model.n_lags[2])]
    assert 0 < len(lags) < len(model.lags)
    # the same rows as for all lags: those that have the longest past and the farthest future
    pasts, futures = windows(trials, model.lags, model.horizons, 1)
    columns = np.repeat(np.isin(model.lags, lags), 3)
    weights = np.linalg.lstsq(pasts[:, columns], futures[:, 2])[0]
    wanted = y[698] + (y[698 - lags] - y[698]).reshape(-1) @ weights
    # shifted by one, so that the freshest sample is one that is there
    shifted = [index - 1 for index in there if index - 1 < 698] + [698]
    _, estimate = DirectLs(model).step(None, playout_of(y, shifted), sample_instant_ns(701, RATE_HZ))
    assert estimate.position_m == pytest.approx(wanted, abs=1e-7)


def test_between_horizons_it_interpolates_and_beyond_the_last_it_stays(estimator: DirectLs) -> None:
    playout = playout_of(movement(200, 51), list(range(200)))

    def at(steps: float) -> tuple[Array, Array]:
        now_ns = sample_instant_ns(199, RATE_HZ) + round(steps * 1e9 / RATE_HZ)
        _, estimate = estimator.step(None, playout, now_ns)
        assert estimate.position_m is not None
        assert estimate.covariance_m2 is not None
        return estimate.position_m, estimate.covariance_m2

    for below, above, share in ((2, 3, 0.25), (15, 18, 0.5), (120, 150, 0.1)):
        mixed = (1 - share) * at(below)[0] + share * at(above)[0]
        assert at(below + share * (above - below))[0] == pytest.approx(mixed, abs=1e-9)
    start, fresh = at(0.0)
    assert start == pytest.approx(playout.arm.get(199))
    assert fresh == pytest.approx(np.zeros((3, 3)))
    assert at(0.5)[0] == pytest.approx((start + at(1.0)[0]) / 2, abs=1e-9)
    assert at(0.5)[1] == pytest.approx(at(1.0)[1] / 4, rel=1e-6)
    assert at(600.0)[0] == pytest.approx(at(150.0)[0])
    assert at(600.0)[1] == pytest.approx(4 * at(150.0)[1])


def test_ellipsoids_cover_what_they_say(estimator: DirectLs) -> None:
    inside: list[bool] = []
    for seed in range(4):
        y = movement(900, 60 + seed)
        lost = np.random.default_rng(seed).random(len(y)) < 0.2
        arrivals = [LOST if lost[i] else t for i, t in enumerate(delayed(len(y), 150_000_000))]
        estimates = play(estimator, Streams(y, y, [LOST] * len(y), arrivals))
        inside += inside_95(estimates[120:-1], truth_at_ticks(y)[120:-1])
    assert 0.90 < np.mean(inside) < 0.98


def test_one_sample_alone_is_held() -> None:
    y = movement(700, 1)
    estimator = DirectLs(fit_direct([y], RATE_HZ))
    assert estimator.step(None, Playout(RATE_HZ), 0)[1].position_m is None
    _, estimate = estimator.step(None, playout_of(y, [5]), sample_instant_ns(8, RATE_HZ))
    assert np.array_equal(np.asarray(estimate.position_m), y[5])
    assert estimate.covariance_m2 is not None


def test_a_model_file_without_moments_is_named() -> None:
    with pytest.raises(DataError, match="direct_ls needs moments of the arm's movement"):
        direct_ls(replace(static_model(), direct=None))


def test_on_a_real_trial_it_beats_the_last_velocity(jigsaws_dir: Path) -> None:
    y = real_recording(jigsaws_dir, "Suturing_D002").hands[0].follower.position_m
    estimator = DirectLs(fit_direct([y[:1240]], RATE_HZ))
    y = y[1240:]
    for delay_ms, bound in ((33, 0.5), (100, 0.5), (200, 0.62)):
        streams = Streams(y, y, [LOST] * len(y), delayed(len(y), delay_ms * 1_000_000))
        found, hold = positions(play(estimator, streams)), positions(play(Hold(), streams))
        scored = slice(70, -1)
        assert ratio_to_hold(found[scored], hold[scored], truth_at_ticks(y)[scored]) < bound
