import numpy as np
import pytest
from scipy.linalg import solve_discrete_are

from tests.patient_side.identification.known_systems import innovation_markov, sorted_eigenvalues
from tis.patient_side.identification.stochastic_moesp import InnovationsForm, filter_riccati, innovations_form


def noisy_system(n: int, seed: int, radius: float = 0.9) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n))
    A *= radius / np.max(np.abs(np.linalg.eigvals(A)))
    joint = rng.normal(size=(n + 3, n + 3))
    joint = joint @ joint.T
    return A, rng.normal(size=(3, n)), joint[:n, :n], joint[n:, n:], joint[:n, n:]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("n", [1, 4, 12])
def test_the_riccati_solution_is_scipys(n: int, seed: int) -> None:
    A, C, Q, R, S = noisy_system(n, seed)
    expected = solve_discrete_are(A.T, C.T, Q, R, s=S)
    assert np.max(np.abs(filter_riccati(A, C, Q, R, S) - expected)) < 1e-10 * np.max(np.abs(expected))


def test_it_is_where_kalmans_recursion_ends() -> None:
    A, C, Q, R, S = noisy_system(5, 1, radius=0.999)
    P = Q.copy()
    for _ in range(2000):
        Re = C @ P @ C.T + R
        K = np.linalg.solve(Re, (A @ P @ C.T + S).T).T
        P = A @ P @ A.T + Q - K @ Re @ K.T
    form = innovations_form(A, C, Q, R, S)
    assert np.max(np.abs(form.K - K)) < 1e-10 * np.max(np.abs(K))
    assert np.max(np.abs(form.Re - Re)) < 1e-10 * np.max(np.abs(Re))
    assert np.max(np.abs(np.linalg.eigvals(A - form.K @ C))) < 1


def test_an_innovations_form_is_its_own() -> None:
    """Q = K Re K', S = K Re, R = Re: without the cross term another gain would come out."""
    A, C, Q, R, S = noisy_system(4, 2)
    form = innovations_form(A, C, Q, R, S)
    again = innovations_form(A, C, form.K @ form.Re @ form.K.T, form.Re, form.K @ form.Re)
    assert np.allclose(again.K, form.K, rtol=1e-9)
    assert np.allclose(again.Re, form.Re, rtol=1e-9)
    crossless = innovations_form(A, C, form.K @ form.Re @ form.K.T, form.Re, np.zeros_like(form.K))
    assert not np.allclose(crossless.K, form.K, rtol=0.1)


def test_units_change_what_they_should() -> None:
    A, C, Q, R, S = noisy_system(3, 3)
    form = innovations_form(A, C, Q, R, S)
    scale = np.array([1e-3, 2.0, 50.0])
    scaled = form.in_units(scale)
    assert np.allclose(innovation_markov(scaled, 5), scale[:, None] * innovation_markov(form, 5) / scale)
    assert np.allclose(scaled.Re, np.diag(scale) @ form.Re @ np.diag(scale))
    assert np.allclose(sorted_eigenvalues(scaled.A - scaled.K @ scaled.C), sorted_eigenvalues(A - form.K @ C))


def test_markov_parameters_are_the_answers_to_an_innovation() -> None:
    form = InnovationsForm(np.array([[0.5]]), np.array([[2.0]]), np.array([[3.0]]), np.eye(1))
    assert innovation_markov(form, 3).reshape(-1).tolist() == [6.0, 3.0, 1.5]
