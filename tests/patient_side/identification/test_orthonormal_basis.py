import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag, solve_discrete_lyapunov
from scipy.signal import lfilter

from tests.patient_side.identification.known_systems import Array, four_states, sorted_eigenvalues
from tis.patient_side.identification.output_error import OrthonormalBasis


def with_eigenvalues(seed: int, n_pairs: int, n_real: int) -> Array:
    """Return a matrix with random stable eigenvalues, in coordinates that show nothing of them."""
    rng = np.random.default_rng(seed)
    radii, angles = rng.uniform(0, 0.99, n_pairs), rng.uniform(0.1, 3, n_pairs)
    pairs = [
        r * np.array([[np.cos(a), np.sin(a)], [-np.sin(a), np.cos(a)]]) for r, a in zip(radii, angles, strict=True)
    ]
    A = block_diag(*pairs, *[np.array([[x]]) for x in rng.uniform(-0.99, 0.99, n_real)])
    T = np.linalg.qr(rng.normal(size=A.shape))[0] + 0.1 * rng.normal(size=A.shape)
    return np.asarray(T @ A @ np.linalg.inv(T))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000), n_pairs=st.integers(0, 3), n_real=st.integers(0, 3))
def test_poles_are_kept_and_white_input_gives_white_states(seed: int, n_pairs: int, n_real: int) -> None:
    if n_pairs + n_real == 0:
        return
    A = with_eigenvalues(seed, n_pairs, n_real)
    basis = OrthonormalBasis.with_poles(A)
    assert sorted_eigenvalues(basis.A) == pytest.approx(sorted_eigenvalues(A), abs=1e-7)
    covariance = solve_discrete_lyapunov(basis.A, np.outer(basis.b, basis.b))
    assert covariance == pytest.approx(np.eye(len(A)), abs=1e-8)


def test_the_states_are_those_of_the_chain_as_one_system() -> None:
    basis = OrthonormalBasis.with_poles(with_eigenvalues(3, 2, 2))
    signals = np.random.default_rng(0).normal(size=(2, 50))
    states = basis.states(signals)
    g = np.zeros((6, 2))
    for k in range(50):
        assert states[:, :, k] == pytest.approx(g, abs=1e-12)
        g = basis.A @ g + np.outer(basis.b, signals[:, k])


@pytest.mark.parametrize(
    "A",
    [four_states().A, 0.7 * np.eye(3), np.array([[0.6, 1.0], [0.0, 0.6]]), np.zeros((2, 2)), np.diag([0.999, 0.998])],
    ids=["distinct", "three times one pole", "a Jordan block", "deadbeat", "slow"],
)
def test_every_response_is_the_combination_that_it_says(A: Array) -> None:
    C = np.random.default_rng(1).normal(size=(2, len(A)))
    basis = OrthonormalBasis.with_poles(A)
    combination = basis.combination(A, C)
    g, power = basis.b, np.eye(len(A))
    for _ in range(40):
        assert np.einsum("olj,l->oj", combination, g) == pytest.approx(C @ power, abs=1e-9)
        g, power = basis.A @ g, power @ A


@pytest.mark.parametrize(
    ("away", "angle"), [(1e-8, 0.0), (1e-8, 1e-9), (1e-6, 1e-7), (1e-3, 3.0), (1e-8, np.pi - 1e-8)]
)
def test_a_pair_of_poles_close_to_the_circle_and_to_each_other_has_its_section(away: float, angle: float) -> None:
    # such a pair's states, in companion form, are alike but for 1e-16: their covariance has no Cholesky factor
    r, c, s = 1 - away, np.cos(angle), np.sin(angle)
    A = r * np.array([[c, s], [-s, c]])
    basis = OrthonormalBasis.with_poles(A)
    assert np.trace(basis.A) == pytest.approx(2 * r * c, abs=1e-12)
    assert np.linalg.det(basis.A) == pytest.approx(r**2, abs=1e-12)
    assert basis.A @ basis.A.T + np.outer(basis.b, basis.b) == pytest.approx(np.eye(2), abs=1e-12)


@given(poles=st.lists(st.floats(-0.99, 0.99), min_size=1, max_size=3), seed=st.integers(0, 2**32 - 1))
def test_each_real_section_is_scipys_filter(poles: list[float], seed: int) -> None:
    basis = OrthonormalBasis.with_poles(np.diag(poles))
    signals = np.random.default_rng(seed).normal(size=(2, 50))
    states = basis.states(signals)
    for pole, state in zip((section.A[0, 0] for section in basis.sections), states, strict=True):
        rest = np.sqrt(1 - pole**2)
        assert state == pytest.approx(lfilter([0.0, rest], [1.0, -pole], signals), abs=1e-9)
        signals = lfilter([-pole, 1.0], [1.0, -pole], signals)
