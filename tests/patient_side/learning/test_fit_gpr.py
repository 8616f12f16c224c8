from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.learning.tracks import SPREAD_RAD, USUAL_M, linear, turning
from tis.patient_side.learned.gaussian_process import AGES, N_FEATURES, features_of, kernel, outputs
from tis.patient_side.learning import fit_gpr as module
from tis.patient_side.learning.examples import examples_of
from tis.patient_side.learning.fit_gpr import fit_gpr, whiten
from tis.patient_side.learning.process_scales import noise_on

SCALE = np.full(N_FEATURES, 0.2)


def test_with_all_rows_as_points_it_is_the_closed_form() -> None:
    rng = np.random.default_rng(0)
    x, y = 0.7 * rng.normal(size=(40, 6)), rng.normal(size=(40, 2, 3))
    whitened = whiten(x, x, y)
    K = kernel(x, x)
    new = 0.7 * rng.normal(size=(5, 6))
    z = kernel(new, x) @ whitened.root.T
    for ratio in (0.1, 1.0, 30.0):
        mean = np.einsum("bm,amc->bac", z, whitened.mean(np.full(2, ratio)))
        exact = kernel(new, x) @ np.linalg.solve(K + ratio * np.eye(40), y.reshape(40, -1))
        np.testing.assert_allclose(mean.reshape(5, -1), exact, atol=2e-3)
        # The variance: prior less what the rows tell.
        left = ratio / (whitened.eigenvalues + ratio)
        variance = 1.0 - (z * z) @ (1.0 - left)
        told = np.einsum("bi,ij,bj->b", kernel(new, x), np.linalg.inv(K + ratio * np.eye(40)), kernel(new, x))
        np.testing.assert_allclose(variance, 1.0 - told, atol=2e-3)


def test_circles_are_learned_and_the_stated_deviation_is_that_of_the_errors(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "N_POINTS", 150)
    seen, held = (
        examples_of([turning(i, 500, "A") for i in seeds], linear(), USUAL_M, SPREAD_RAD, 1, 2, AGES)
        for seeds in (range(4), range(4, 6))
    )
    weights, _ = fit_gpr(seen, held, SCALE, 1)
    mean, deviation = outputs(weights, features_of(held.window))
    near = AGES <= 15
    left, before = (np.mean((each) ** 2, axis=(0, 2))[near] for each in (held.left - mean, held.left))
    assert np.all(left < 0.5 * before)
    ratio = np.sqrt(np.mean((held.left - mean) ** 2, axis=(0, 2))) / np.sqrt(np.mean(deviation**2, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=0.1)


def test_what_cannot_be_learned_is_left_alone() -> None:
    rng = np.random.default_rng(0)
    x = rng.normal(size=(300, N_FEATURES)) * 0.2
    examples = examples_of([turning(0, 460)], linear(), USUAL_M, SPREAD_RAD, 1, 1, AGES)
    noise = rng.normal(size=(len(examples), len(AGES), 3))
    whitened = whiten(x[:50], x, rng.normal(size=(300, len(AGES), 3)))
    z = kernel(x[: len(examples)], x[:50]) @ whitened.root.T

    ratio, squares = noise_on(
        z, whitened.mean, replace(examples.rows(np.arange(len(z))), left=noise[: len(z)].astype(np.float32))
    )
    assert np.median(ratio) >= 100.0
    np.testing.assert_allclose(squares, 1.0, atol=0.2)


def test_with_all_rows_as_points_it_is_scikit_learns_regressor() -> None:
    gaussian_process = pytest.importorskip("sklearn.gaussian_process", reason="needs the extra learned")
    rng = np.random.default_rng(3)
    x, y, new = 0.7 * rng.normal(size=(40, 6)), rng.normal(size=(40, 2, 3)), 0.7 * rng.normal(size=(5, 6))
    kernel_1 = gaussian_process.kernels.RBF(1.0, "fixed")
    theirs = gaussian_process.GaussianProcessRegressor(kernel_1, alpha=3.0, optimizer=None).fit(x, y.reshape(40, -1))
    whitened = whiten(x, x, y)
    z = kernel(new, x) @ whitened.root.T
    ours = np.einsum("bm,amc->bac", z, whitened.mean(np.full(2, 3.0)))
    np.testing.assert_allclose(ours.reshape(5, -1), theirs.predict(new), atol=2e-3)
