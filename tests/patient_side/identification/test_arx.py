import numpy as np
import pytest

from tests.patient_side.identification.known_systems import Array, four_states, markov, sorted_eigenvalues
from tis.common.errors import DataError
from tis.patient_side.identification import arx
from tis.patient_side.identification.arx import ArxFactor
from tis.patient_side.identification.noise import innovations
from tis.patient_side.linear_system import StateSpace


def arx_run(n_rows: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return two inputs and outputs of a known second-order ARX process with innovations of 0.1."""
    A1, A2 = np.array([[0.9, 0.2], [-0.1, 0.5]]), np.array([[-0.3, 0.0], [0.1, 0.2]])
    B0, B1 = np.array([[0.3, 0.0], [0.1, 0.2]]), np.array([[0.5, -0.2], [0.0, 0.4]])
    u, e, y = rng.normal(size=(n_rows, 2)), 0.1 * rng.normal(size=(n_rows, 2)), np.zeros((n_rows, 2))
    for k in range(2, n_rows):
        y[k] = A1 @ y[k - 1] + A2 @ y[k - 2] + B0 @ u[k] + B1 @ u[k - 1] + e[k]
    return u, y


def by_hand(trials: list[tuple[Array, Array]], lags: int, first: int) -> tuple[Array, Array, Array]:
    """Return coefficients of [u[k], y[k-1], u[k-1], ...] and the residuals' covariance, row by row."""
    rows, targets = [], []
    for u, y in trials:
        for k in range(first, len(u)):
            past = [np.concatenate([y[k - i], u[k - i]]) for i in range(1, lags + 1)]
            rows.append(np.concatenate([u[k], *past]))
            targets.append(y[k])
    X, Y = np.array(rows), np.array(targets)
    theta = np.linalg.lstsq(X, Y)[0]
    residuals = Y - X @ theta
    return theta, residuals, residuals.T @ residuals / len(Y)


@pytest.mark.parametrize("lags", [0, 1, 2, 4])
def test_every_number_of_lags_is_numpys_least_squares(lags: int) -> None:
    rng = np.random.default_rng(0)
    trials = [arx_run(n, rng) for n in (150, 3, 700)]
    theta, residuals, covariance = by_hand(trials, lags, 4)
    factor = ArxFactor.of(trials, 4)
    assert factor.n_rows == len(residuals)
    assert factor.residual(lags) == pytest.approx(covariance, rel=1e-9)
    space, gain = factor.model(lags)
    assert pytest.approx(theta[:2].T, rel=1e-8) == space.D
    for i in range(lags):
        block = theta[2 + 4 * i : 6 + 4 * i].T
        assert gain[2 * i : 2 * i + 2] == pytest.approx(block[:, :2], rel=1e-8)
    # the predictor in innovations form has the residuals, once it has seen as many rows as it has lags
    errors = innovations(space, gain, [np.zeros(2 * lags)] * 3, trials)
    assert errors[2][4:] == pytest.approx(residuals[-len(errors[2]) + 4 :], abs=1e-9)


def test_a_known_process_comes_back() -> None:
    u, y = arx_run(20_000, np.random.default_rng(1))
    found = arx.identify(u, y, 2, 5)
    # how the outputs answer to an innovation, worked out from A1 and A2 by hand: A1, then A1 A1 + A2
    A1, A2 = np.array([[0.9, 0.2], [-0.1, 0.5]]), np.array([[-0.3, 0.0], [0.1, 0.2]])
    answers = StateSpace(found.space.A, found.noise.gain, found.space.C, np.eye(2))
    assert markov(answers, 3)[1:] == pytest.approx(np.array([A1, A1 @ A1 + A2]), abs=0.02)
    assert pytest.approx(np.array([[0.3, 0.0], [0.1, 0.2]]), abs=0.005) == found.space.D
    assert pytest.approx(0.01 * np.eye(2), abs=5e-4) == found.noise.R
    assert pytest.approx(found.noise.gain @ found.noise.R) == found.noise.S
    assert (found.provenance.method, found.provenance.order, found.space.order) == ("arx", 2, 4)


def test_a_noise_free_system_comes_back_exactly() -> None:
    rng, whole = np.random.default_rng(2), four_states()
    # two of its outputs: two lags of two outputs are its four states, and no mode is left over
    true = StateSpace(whole.A, whole.B, whole.C[:2], whole.D[:2])
    u = rng.normal(size=(400, 2))
    y = true.simulate(u, rng.normal(size=4))
    found = arx.identify(u, y, 2, 6)
    assert sorted_eigenvalues(found.space.A) == pytest.approx(sorted_eigenvalues(true.A), abs=1e-10)
    assert markov(found.space, 20) == pytest.approx(markov(true, 20), abs=1e-10)
    assert found.space.simulate(u, found.x0[0]) == pytest.approx(y, abs=1e-9)
    redundant = arx.identify(u, y, 5, 6)
    assert markov(redundant.space, 20) == pytest.approx(markov(true, 20), abs=1e-10)


def test_without_inputs_it_is_the_autoregression() -> None:
    rng = np.random.default_rng(3)
    y = np.zeros((4000, 1))
    for k in range(2, 4000):
        y[k] = 1.5 * y[k - 1] - 0.7 * y[k - 2] + rng.normal()
    space, gain = ArxFactor.of([(np.empty((4000, 0)), y)], 3).model(2)
    assert gain[:, 0] == pytest.approx([1.5, -0.7], abs=0.04)
    assert space.B.shape == (2, 0)
    assert sorted_eigenvalues(space.A) == pytest.approx(np.sort_complex(np.roots([1, -gain[0, 0], -gain[1, 0]])))


def test_an_unstable_fit_is_made_stable_and_says_so() -> None:
    rng = np.random.default_rng(4)
    u, y = rng.normal(size=(120, 1)), np.zeros((120, 1))
    for k in range(119):
        y[k + 1] = 1.02 * y[k] + u[k]
    found = arx.identify(u, y, 1, 5)
    assert found.space.A[0, 0] == pytest.approx(1 / 1.02)
    assert any("ARX model of 1 lags was unstable, spectral radius 1.02:" in w for w in found.warnings)


def test_more_lags_than_the_horizon_are_refused() -> None:
    u, y = arx_run(300, np.random.default_rng(5))
    with pytest.raises(DataError, match=r"order: must lie in 0\.\.4, the lags of arx \(got 5\)"):
        arx.identify(u, y, 5, 4)
