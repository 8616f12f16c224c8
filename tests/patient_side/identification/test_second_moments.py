import numpy as np
import pytest

from tests.patient_side.arm_models import random_command
from tis.patient_side.identification.direct_ls import fit_direct, moments, pooled, random_walk, regression, windows
from tis.patient_side.linear_system import Array

LAGS, HORIZONS = np.array([1, 2, 4]), np.array([1, 3])


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


def test_parts_are_runs_of_rows_one_after_another() -> None:
    trials = [movement(n, n) for n in (50, 5, 90)]  # 43, none and 83 rows
    parts = moments(trials, LAGS, HORIZONS, 1, 4)
    pasts, futures = windows(trials, LAGS, HORIZONS, 1)
    borders = [0, 31, 63, 94, 126]  # the third is in the last trial
    assert len(pasts) == borders[-1]
    for part, begin, end in zip(parts, borders[:-1], borders[1:], strict=True):
        z, t = pasts[begin:end], futures[begin:end]
        assert part.n_rows == end - begin
        assert part.past == pytest.approx(z.T @ z / len(z), rel=1e-9, abs=1e-16)
        assert part.cross[1] == pytest.approx(z.T @ t[:, 1] / len(z), rel=1e-9, abs=1e-16)
    whole = pooled(parts)
    assert whole.n_rows == len(pasts)
    assert whole.future[0] == pytest.approx(futures[:, 0].T @ futures[:, 0] / len(pasts), rel=1e-9, abs=1e-16)


def test_what_weights_leave_and_move_is_summed_over_the_rows() -> None:
    trials = [movement(80, 1)]
    (found,) = moments(trials, LAGS, HORIZONS, 1, 1)
    walk = random_walk(found.past, LAGS)
    weights = found.weights(walk, 0.3, 6)
    for j in range(2):
        assert weights[:, 3 * j : 3 * j + 3] == pytest.approx(regression(found, walk, 0.3, j, slice(6))[0])
    pasts, futures = windows([movement(60, 2)], LAGS, HORIZONS, 1)  # of other rows
    (other,) = moments([movement(60, 2)], LAGS, HORIZONS, 1, 1)
    forecast = (pasts[:, :6] @ weights).reshape(len(pasts), 2, 3)
    left = np.sum((futures - forecast) ** 2, axis=(0, 2)) / len(pasts)
    assert other.squares_left(weights) == pytest.approx(left, rel=1e-9)
    assert other.squares_moved(weights) == pytest.approx(np.sum(forecast**2, axis=(0, 2)) / len(pasts), rel=1e-9)
