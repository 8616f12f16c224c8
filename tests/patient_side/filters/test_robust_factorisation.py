import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.patient_side.filters.hankel_completion import largest, left_factor, low_rank_part
from tis.patient_side.linear_system import Array


def about_level(columns: Array) -> Array:
    return np.asarray(columns - columns.mean(axis=0))


def test_the_factors_are_the_left_singular_vectors_of_columns_without_their_levels() -> None:
    rng = np.random.default_rng(1)
    columns = rng.normal(size=(12, 40)) * np.linspace(1.0, 3.0, 12)[:, None] + rng.normal(size=40)
    factor = left_factor(columns @ columns.T / 40, 3, 2.0, 1e-12)
    left, values, _ = np.linalg.svd(about_level(columns))
    assert factor.basis[:, 0] == pytest.approx(np.full(12, 12**-0.5))
    for found, wanted in zip(factor.basis[:, 1:].T, left[:, :3].T, strict=True):
        assert abs(found @ wanted) == pytest.approx(1.0)
    # The ridge: the mean of the variances that are left, 8 beside level and rank, over each factor's.
    variances = values**2 / 40
    assert factor.shrinkage == pytest.approx([0.0, *(2.0 * variances[3:11].mean() / variances[:3])], abs=1e-11)


def test_of_whole_columns_the_low_rank_part_is_the_truncated_svd_beside_the_levels() -> None:
    rng = np.random.default_rng(2)
    columns = rng.normal(size=(10, 30)) + 5.0 * rng.normal(size=30)
    left, values, right = np.linalg.svd(about_level(columns), full_matrices=False)
    wanted = columns.mean(axis=0) + (left[:, :4] * values[:4]) @ right[:4]
    factor = left_factor(columns @ columns.T, 4, 0.0, 1e-12)
    found = low_rank_part(columns.T[:, None], np.ones((30, 10), dtype=bool), factor)
    assert found[:, 0] == pytest.approx(wanted.T, abs=1e-9)


def test_of_columns_with_gaps_it_is_least_squares_on_what_is_known() -> None:
    rng = np.random.default_rng(3)
    factor = left_factor(np.cov(rng.normal(size=(9, 50))), 2, 0.0, 1e-12)
    columns, known = rng.normal(size=(5, 3, 9)), rng.random((5, 9)) > 0.3
    found = low_rank_part(np.where(known[:, None], columns, 1e3), known, factor)
    for column, its, low_rank in zip(columns, known, found, strict=True):
        weights = np.linalg.lstsq(factor.basis[its], column.T[its])[0]
        assert low_rank == pytest.approx((factor.basis @ weights).T, abs=1e-8)


def test_a_wide_ridge_leaves_the_level() -> None:
    columns = np.random.default_rng(4).normal(size=(6, 1, 8))
    factor = left_factor(np.eye(8), 3, 1e12, 1e-12)
    found = low_rank_part(columns, np.ones((6, 8), dtype=bool), factor)
    assert found == pytest.approx(np.broadcast_to(columns.mean(axis=2)[:, :, None], (6, 1, 8)), abs=1e-9)


def test_the_sparse_part_takes_the_largest_and_none_below_the_least() -> None:
    sizes = np.array([0.1, 5.0, 0.2, 3.0, 4.0])
    assert largest(sizes, 2, 0.0).tolist() == [False, True, False, False, True]
    assert largest(sizes, 4, 3.5).tolist() == [False, True, False, False, True]
    assert not largest(sizes, 0, 0.0).any()
    assert not largest(sizes, 5, 5.0).any()


@given(st.lists(st.floats(0, 10), min_size=1, max_size=20), st.integers(0, 25))
def test_there_are_never_more_outliers_than_allowed(sizes: list[float], n_largest: int) -> None:
    chosen = largest(np.array(sizes), n_largest, 0.5)
    assert chosen.sum() == min(n_largest, sum(size > 0.5 for size in sizes))
