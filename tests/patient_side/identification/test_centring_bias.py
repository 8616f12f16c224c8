"""Decays about a mean: against least squares on random walks, and on constructed matrices."""

import numpy as np
import pytest

from tests.patient_side.identification.known_systems import sorted_eigenvalues
from tis.patient_side.identification.stochastic_moesp import InnovationsForm
from tis.patient_side.identification.structure import corrected, without_centring_bias


def test_random_walks_come_out_as_such_on_average() -> None:
    rng, found, n_rows = np.random.default_rng(0), [], 300
    for _ in range(400):
        y = np.cumsum(rng.normal(size=n_rows))
        y -= y.mean()
        found.append(float(y[1:] @ y[:-1] / (y[:-1] @ y[:-1])))
    after = [float(corrected(np.array([[r]]), n_rows)[0, 0]) for r in found]
    assert 1 - np.mean(found) == pytest.approx(5.4 / n_rows, rel=0.15)  # Dickey and Fuller's mean
    assert 1 - np.mean(after) < 0.5 * (1 - np.mean(found))
    assert all(r <= a < 1.0 for r, a in zip(found, after, strict=True) if r < 1.0 - 1 / 3000)


def test_only_the_slowest_decay_moves() -> None:
    rng = np.random.default_rng(1)
    T = rng.normal(size=(4, 4))
    rest = np.array([[0.6, 0.5], [-0.5, 0.6]])
    A = np.zeros((4, 4))
    A[0, 0], A[1, 1], A[2:, 2:] = 0.995, 0.9, rest
    moved = corrected(T @ A @ np.linalg.inv(T), 1000.0)
    A[0, 0] = 0.995 + (1 + 3 * 0.995) / 1000
    assert sorted_eigenvalues(moved) == pytest.approx(sorted_eigenvalues(A), abs=1e-10)


@pytest.mark.parametrize("r", [0.98, -0.999, 0.9999])
def test_what_is_no_slow_decay_stays(r: float) -> None:
    """Clearly quicker than a random walk; an oscillation; slower already than a trial can tell."""
    A = np.diag([r, 0.5])
    assert corrected(A, 1000.0) == pytest.approx(A, abs=1e-12)


def test_a_swing_stays() -> None:
    A = 0.999 * np.array([[np.cos(0.1), np.sin(0.1)], [-np.sin(0.1), np.cos(0.1)]])
    assert np.array_equal(corrected(A, 1000.0), A)
    assert np.array_equal(corrected(np.empty((0, 0)), 1000.0), np.empty((0, 0)))


def test_a_gain_that_would_not_do_keeps_its_model() -> None:
    A, one = np.array([[0.99]]), np.eye(1)
    kept = InnovationsForm(A, one, np.array([[0.5]]), one)
    assert without_centring_bias(kept, 300.0).A[0, 0] == pytest.approx(
        0.99 + 3.97 / 300 - (0.99 + 3.97 / 300 - 2999 / 3000)
    )
    barely = InnovationsForm(A, one, np.array([[-0.0099]]), one)  # A - K C is 0.9999
    assert without_centring_bias(barely, 300.0) is barely
