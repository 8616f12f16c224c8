"""The share of errors within their ellipsoids, against solving row by row and against what is known."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import ndtri

from tis.common.metrics.consistency import CHI2_3_95
from tis.common.streams import Stream
from tis.deploy.compare.cells.sums import covered


def _normal(label: str, *shape: int) -> np.ndarray:
    n = int(np.prod(shape))
    return np.asarray(ndtri(Stream.named(3, label).uniforms(0, n))).reshape(shape)


@given(st.integers(0, 50), st.floats(1e-5, 1e-1))
def test_an_error_is_inside_where_its_squared_distance_is_small(seed: int, scale: float) -> None:
    roots = scale * _normal(f"roots/{seed}", 20, 3, 3)
    covariances = roots @ roots.transpose(0, 2, 1) + 1e-3 * scale**2 * np.eye(3)
    errors = 1.5 * scale * _normal(f"errors/{seed}", 20, 3)
    inside = sum(float(e @ np.linalg.solve(P, e)) <= CHI2_3_95 for e, P in zip(errors, covariances, strict=True))
    assert covered(errors, covariances) == (inside, 20)


def test_of_errors_drawn_from_their_covariance_95_per_cent_are_inside() -> None:
    root = np.array([[2e-3, 0, 0], [1e-3, 5e-4, 0], [-2e-3, 1e-4, 1e-3]])
    errors = _normal("drawn", 20_000, 3) @ root.T
    inside, n = covered(errors, np.broadcast_to(root @ root.T, (n_rows := 20_000, 3, 3)))
    assert n == n_rows
    assert inside / n == pytest.approx(0.95, abs=0.005)
    half, _ = covered(errors, np.broadcast_to(root @ root.T / 4, (n_rows, 3, 3)))
    assert half / n < 0.65


def test_rows_without_covariance_do_not_count_and_flat_ellipsoids_hold_their_range() -> None:
    covariances = np.array([np.full((3, 3), np.nan), np.diag([1e-6, 1e-6, 0.0]), np.diag([1e-6, 1e-6, 0.0])])
    errors = np.array([[0, 0, 0], [1e-3, 0, 0], [0, 0, 1e-6]])
    assert covered(errors, covariances) == (1, 2)
    assert covered(errors[:1], covariances[:1]) == (0, 0)
