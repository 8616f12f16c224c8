import numpy as np
import pytest

from common.errors import DataError
from patient_side.identification.direct_ls import fit_direct, random_walk, regression, windows
from patient_side.statespace import Array
from tests.patient_side.arm_models import random_command


def movement(n_rows: int, seed: int) -> Array:
    return random_command(np.random.default_rng(seed), n_rows, 0.9, 1e-4)


def test_the_moments_are_those_of_rows_built_one_by_one() -> None:
    trials = [movement(n, n) for n in (300, 40, 420)]  # the second has no row with past and future
    model = fit_direct(trials, 30)
    lags, horizons = model.lags.tolist(), model.horizons.tolist()
    assert (lags[0], lags[-1], horizons[0], horizons[-1]) == (1, 40, 1, 90)
    pasts, futures = [], []
    for y in trials:
        for k in range(lags[-1], len(y) - horizons[-1]):
            pasts.append(np.concatenate([y[k - lag] - y[k] for lag in lags]))
            futures.append([y[k + h] - y[k] for h in horizons])
    z, t = np.array(pasts), np.array(futures)
    assert model.past == pytest.approx(z.T @ z / len(z), rel=1e-9, abs=1e-16)
    assert model.cross[3] == pytest.approx(z.T @ t[:, 3] / len(z), rel=1e-9, abs=1e-16)
    assert model.future[5] == pytest.approx(t[:, 5].T @ t[:, 5] / len(z), rel=1e-9, abs=1e-16)


def test_a_regression_is_ridge_regression_on_the_rows() -> None:
    trials = [movement(500, 1)]
    model = fit_direct(trials, 30)
    pasts, futures = windows(trials, model.lags, model.horizons, 1)
    walk, kept = random_walk(model.past, model.lags), np.array([0, 1, 2, 6, 7, 8, 30, 31, 32])
    weights, left = regression(model, walk, 0.1, 4, kept)
    root = np.linalg.cholesky(0.1 * len(pasts) * walk[np.ix_(kept, kept)]).T
    padded = np.vstack([futures[:, 4], np.zeros((9, 3))])
    wanted = np.linalg.lstsq(np.vstack([pasts[:, kept], root]), padded)[0]
    assert weights == pytest.approx(wanted, rel=1e-6, abs=1e-9)
    residuals = futures[:, 4] - pasts[:, kept] @ wanted
    assert left == pytest.approx(residuals.T @ residuals / len(pasts) + 1e-12 * np.eye(3), rel=1e-6)


def test_steps_stay_a_thirtieth_of_a_second_at_higher_rates() -> None:
    slow = movement(600, 2)
    fast = np.repeat(slow, 4, axis=0)[: 4 * 600 - 3]
    at_120 = fit_direct([fast], 120)
    assert at_120.stride == 4
    assert np.array_equal(at_120.lags, fit_direct([slow], 30).lags)


def test_of_noise_nothing_is_concluded_from_long_ago() -> None:
    rng = np.random.default_rng(3)
    walk = fit_direct([1e-4 * np.cumsum(rng.normal(size=(1200, 3)), axis=0)], 30)
    weights, _ = regression(walk, random_walk(walk.past, walk.lags), walk.penalty[4], 4, slice(3 * walk.n_lags[4]))
    moved = np.sqrt(np.mean((walk.past[:3, :3] @ weights[:3]) ** 2)) / np.sqrt(np.trace(walk.future[4]) / 3)
    assert walk.n_lags[4] <= 10
    assert moved < 0.1


def test_too_few_rows_are_refused() -> None:
    with pytest.raises(DataError, match="direct_ls needs"):
        fit_direct([movement(7, 0)], 30)
    fit_direct([movement(60, 0)], 30)


def test_the_trials_are_not_modified() -> None:
    y = movement(300, 5)
    before = y.copy()
    y.flags.writeable = False
    fit_direct([y], 30)
    assert np.array_equal(y, before)
