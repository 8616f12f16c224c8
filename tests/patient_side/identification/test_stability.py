import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.identification.known_systems import ROTATION, sorted_eigenvalues
from tis.patient_side.identification.output_error import STABLE_BELOW, stabilised


def test_a_stable_matrix_comes_back_as_it_is() -> None:
    A, radius = stabilised(ROTATION)
    assert A is ROTATION
    assert radius == pytest.approx(0.95 * np.sqrt(0.9))


def test_each_kind_of_eigenvalue_goes_where_it_should() -> None:
    rng = np.random.default_rng(0)
    pair = 1.25 * np.array([[np.cos(1.0), np.sin(1.0)], [-np.sin(1.0), np.cos(1.0)]])
    A = np.zeros((6, 6))
    A[:2, :2] = pair
    A[2:, 2:] = np.diag([-2.0, 1.0, 1.0000001, 0.3])
    T = rng.normal(size=(6, 6))
    found, radius = stabilised(T @ A @ np.linalg.inv(T))
    assert radius == pytest.approx(2.0)
    wanted = np.array([0.8 * np.exp(1j), 0.8 * np.exp(-1j), -0.5, 0.999, 0.999, 0.3])
    assert sorted_eigenvalues(found) == pytest.approx(np.sort_complex(wanted), abs=1e-6)


def test_a_double_integrator_is_not_torn_apart() -> None:
    A, _ = stabilised(np.array([[1.0, 1.0], [0.0, 1.0]]))
    assert pytest.approx(np.array([[0.999, 1.0], [0.0, 0.999]])) == A


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.floats(0.1, 5.0))
def test_the_result_is_always_stable_and_real(seed: int, n: int, scale: float) -> None:
    A = scale * np.random.default_rng(seed).normal(size=(n, n))
    found, radius = stabilised(A)
    assert radius == pytest.approx(float(np.max(np.abs(np.linalg.eigvals(A)))))
    assert float(np.max(np.abs(np.linalg.eigvals(found)))) < 1
    assert found.dtype == np.float64


def test_no_states_are_stable() -> None:
    assert stabilised(np.empty((0, 0)))[1] == 0.0


def test_a_pole_within_rounding_of_the_circle_is_moved_too() -> None:
    A, radius = stabilised(np.diag([1 - 1e-12, 0.5]))
    assert radius == 1 - 1e-12
    assert sorted(np.linalg.eigvals(A).real) == pytest.approx([0.5, 0.999])


def test_what_rounding_leaves_outside_is_shrunk() -> None:
    # Six poles at 1.2 in one Jordan block with a large coupling: eigenvalues of the edited matrix are all rounding.
    A, radius = stabilised(1.2 * np.eye(6) + 1e9 * np.eye(6, k=1) + 1e-9 * np.eye(6, k=-5))
    assert radius > 1
    assert np.max(np.abs(np.linalg.eigvals(A))) < STABLE_BELOW
