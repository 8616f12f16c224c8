import numpy as np
import pytest

from patient_side.identification.coverage import coverage_factor


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
