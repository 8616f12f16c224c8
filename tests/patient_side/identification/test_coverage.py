import numpy as np
import pytest

from tis.patient_side.identification.coverage import coverage_factor, independent_windows, prediction_factor


def test_errors_as_the_covariance_says_need_no_factor() -> None:
    rng = np.random.default_rng(0)
    root = np.array([[2.0, 0.0, 0.0], [0.5, 1.0, 0.0], [0.0, 0.3, 0.1]])
    errors = rng.normal(size=(40_000, 3)) @ root.T
    assert coverage_factor(errors, root @ root.T, 1) == pytest.approx(1.0, abs=0.03)
    assert coverage_factor(3 * errors, root @ root.T, 1) == pytest.approx(9.0, rel=0.03)


def test_few_windows_count_little() -> None:
    errors = 3 * np.random.default_rng(1).normal(size=(4000, 3))
    full = coverage_factor(errors, np.eye(3), 1)
    assert coverage_factor(errors, np.eye(3), 400) == pytest.approx(np.sqrt(full), rel=0.01)  # ten windows: half
    assert coverage_factor(errors[:0], np.eye(3), 1) == 1.0


@pytest.mark.parametrize("steps", [1, 2, 15, 150])
def test_overlapping_moves_count_as_their_correlation_says(steps: int) -> None:
    doubled = sum((1 - abs(k) / steps) ** 2 for k in range(-steps, steps + 1))
    assert independent_windows(900, steps) == pytest.approx(900 / doubled)


def test_overlapping_moves_of_a_walk_are_worth_so_many_independent_windows() -> None:
    walks = np.cumsum(np.random.default_rng(2).normal(size=(4000, 520)), axis=1)
    moves = walks[:, 20:] - walks[:, :-20]
    variances = np.mean(moves**2, axis=1)
    # of n independent windows: 2 / n of its square
    assert 2 * np.mean(variances) ** 2 / np.var(variances) == pytest.approx(independent_windows(500, 20), rel=0.12)


@pytest.mark.parametrize(("n_windows", "n_free"), [(12, 0), (20, 4), (60, 12), (2000, 10)])
def test_new_errors_of_a_fit_lie_within_95_percent_ellipsoids(n_windows: int, n_free: int) -> None:
    rng, inside = np.random.default_rng(n_windows), []
    factor = prediction_factor(n_windows, n_free)
    for _ in range(1500):
        z, t = rng.normal(size=(n_windows, n_free)), rng.normal(size=(n_windows, 3))
        weights = np.linalg.lstsq(z, t)[0] if n_free else np.zeros((0, 3))
        residuals = t - z @ weights
        covariance = factor * residuals.T @ residuals / n_windows
        new = rng.normal(size=(10, 3)) - rng.normal(size=(10, n_free)) @ weights
        inside.append(np.mean(np.sum(new * np.linalg.solve(covariance, new.T).T, axis=1) < 7.815))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.02)


@pytest.mark.parametrize("n_windows", [6, 12, 60])
def test_new_errors_lie_within_95_percent_ellipsoids_of_their_variances(n_windows: int) -> None:
    rng = np.random.default_rng(n_windows)
    known, new = rng.normal(size=(20_000, n_windows, 3)), rng.normal(size=(20_000, 3))
    variances = prediction_factor(n_windows, 0, whole=False) * np.mean(known**2, axis=1)
    assert np.mean(np.sum(new**2 / variances, axis=1) < 7.815) == pytest.approx(0.95, abs=0.02)


def test_of_hardly_any_windows_the_factor_is_that_of_five() -> None:
    assert prediction_factor(1.5, 0.0) == prediction_factor(5.0, 0.0)
    assert prediction_factor(1e9, 0.0) == pytest.approx(1.0, rel=1e-6)
