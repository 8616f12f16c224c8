import numpy as np
import pytest

from tests.patient_side.learning.tracks import SPREAD_RAD, USUAL_M, linear, turning
from tis.common.streams import Stream
from tis.patient_side.learned.gaussian_process import AGES, N_FEATURES, features_of, kernel, outputs
from tis.patient_side.learning import fit_srlsmf as module
from tis.patient_side.learning.examples import examples_of
from tis.patient_side.learning.fit_srlsmf import Kind, coefficients, decompose, fit_srlsmf

SCALE = np.full(N_FEATURES, 0.2)


def test_the_coefficients_solve_the_factorised_system() -> None:
    rng = np.random.default_rng(0)
    x, left = rng.normal(size=(80, 4)), rng.normal(size=(80, len(AGES), 3))
    found = decompose(kernel(x, x), 20, 0.05, "largest", Stream.named(1, "t"))
    whole = (found.vectors * found.values) @ found.vectors.T + found.sparse.toarray()
    exact = np.linalg.solve(whole + 3.0 * np.eye(80), left.reshape(80, -1))
    ours = np.moveaxis(coefficients(found, 3.0, left), 0, 1).reshape(80, -1)
    np.testing.assert_allclose(ours, exact, atol=1e-3 * np.abs(exact).max())


def test_of_full_rank_it_is_the_exact_process() -> None:
    rng = np.random.default_rng(1)
    x, left = rng.normal(size=(50, 4)), rng.normal(size=(50, len(AGES), 3))
    K = kernel(x, x)
    found = decompose(K, 50, 0.02, "largest", Stream.named(1, "t"))
    exact = np.linalg.solve(K + np.eye(50), left.reshape(50, -1))
    ours = np.moveaxis(coefficients(found, 1.0, left), 0, 1).reshape(50, -1)
    np.testing.assert_allclose(ours, exact, atol=1e-3)


@pytest.mark.parametrize("kind", ["largest", "shrunk"])
def test_circles_are_learned(kind: Kind, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "N_POINTS", 300)
    monkeypatch.setattr(module, "RANK", 60)
    seen, held = (
        examples_of([turning(i, 500, "A") for i in seeds], linear(), USUAL_M, SPREAD_RAD, 1, 1, AGES)
        for seeds in (range(4), range(4, 6))
    )
    weights, _ = fit_srlsmf(seen, held, SCALE, 1, kind)
    assert weights["points"].shape == (300, N_FEATURES)
    mean, deviation = outputs(weights, features_of(held.window))
    near = AGES <= 15
    left, before = (np.mean(each**2, axis=(0, 2))[near] for each in (held.left - mean, held.left))
    assert np.all(left < 0.6 * before)
    np.testing.assert_allclose(deviation[0] ** 2, np.mean((held.left - mean) ** 2, axis=(0, 2)), rtol=1e-3)
