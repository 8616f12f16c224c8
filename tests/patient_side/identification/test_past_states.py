import numpy as np
import pytest

from tests.patient_side.identification.known_systems import Array, Noisy, four_states
from tis.patient_side.identification.hankel import block_hankel, triangular_factor
from tis.patient_side.identification.subspace import PastStates

S = 5


def noisy() -> tuple[Array, Array]:
    rng = np.random.default_rng(3)
    return Noisy(four_states(), 0.5 * rng.normal(size=(4, 4)), 0.3 * np.eye(3)).run(400, rng)


def regression_over_all_columns(u: Array, y: Array, basis: Array) -> tuple[Array, Array]:
    """Return regressors and answers by the definition: oblique projection, states, one column a sample."""
    inputs, outputs = block_hankel(u, 2 * S), block_hankel(y, 2 * S)
    past = np.vstack([inputs[: 2 * S], outputs[: 3 * S]])
    by_all = np.linalg.lstsq(np.vstack([past, inputs[2 * S :]]).T, outputs[3 * S :].T)[0].T
    combine = basis.T @ by_all[:, : len(past)]
    later = np.vstack([inputs[2 : 2 * S + 2], outputs[3 : 3 * S + 3]])
    known = np.vstack([combine @ past, inputs[2 * S : 2 * S + 2]])
    return known.T, np.vstack([combine @ later, outputs[3 * S : 3 * S + 3]]).T


def test_the_triangle_gives_the_regression_over_all_columns() -> None:
    u, y = noisy()
    basis = np.linalg.qr(np.random.default_rng(1).normal(size=(3 * S, 4)))[0]
    states = PastStates.of(triangular_factor([(u, y)], S), S, 2, 3)
    A, C = states.dynamics(basis)
    known, answers = regression_over_all_columns(u, y, basis)
    gains = np.linalg.lstsq(known, answers)[0].T
    assert pytest.approx(gains[:4, :4], abs=1e-9) == A
    assert pytest.approx(gains[4:, :4], abs=1e-9) == C


def test_the_excess_is_that_of_the_residuals_covariance() -> None:
    u, y = noisy()
    basis = np.linalg.qr(np.random.default_rng(2).normal(size=(3 * S, 4)))[0]
    states = PastStates.of(triangular_factor([(u, y)], S), S, 2, 3)
    A, C = states.dynamics(basis)
    assert states.excess(A, C, basis) == pytest.approx(0.0, abs=1e-8)
    wrong = A + 0.05 * np.eye(4)
    known, answers = regression_over_all_columns(u, y, basis)
    least = answers - known @ np.linalg.lstsq(known, answers)[0]
    rest = answers - known[:, :4] @ np.vstack([wrong, C]).T
    rest -= known[:, 4:] @ np.linalg.lstsq(known[:, 4:], rest)[0]
    ratio = np.trace(np.linalg.inv(least.T @ least) @ (rest.T @ rest)) / 7
    assert states.excess(wrong, C, basis) == pytest.approx(ratio - 1, rel=1e-6)
    # no choice of coordinates changes it
    turn = np.linalg.qr(np.random.default_rng(4).normal(size=(4, 4)))[0]
    assert states.excess(turn.T @ wrong @ turn, C @ turn, basis @ turn) == pytest.approx(ratio - 1, rel=1e-6)


def test_without_noise_the_dynamics_are_the_systems() -> None:
    rng, system = np.random.default_rng(5), four_states()
    u = rng.normal(size=(300, 2))
    trial = (u, system.simulate(u))
    factor = triangular_factor([trial], S)
    basis = np.linalg.svd(factor[2 * S :, -3 * S :].T)[0][:, :4]
    A, _ = PastStates.of(factor, S, 2, 3).dynamics(basis)
    found, true = (np.sort_complex(np.linalg.eigvals(each)) for each in (A, system.A))
    assert found == pytest.approx(true, abs=1e-6)
