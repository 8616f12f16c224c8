from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.filters.hankel_completion import column_moments, complete, complete_all
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import Factorisation

EXACT = Factorisation(
    rank=4, ridge=0.0, n_outliers=0, least_outlier_m=0.0, least_noise_m2=1e-24, tolerance_m=1e-10, max_turns=300
)
N_ROWS, N_STEPS = 30, 90
NONE = np.zeros((N_ROWS, N_ROWS))


def damped_sinusoids(n_sinusoids: int, seed: int) -> Array:
    """Three axes (N, 3) with the same modes, so that their Hankel matrix has twice as many dimensions as modes."""
    rng = np.random.default_rng(seed)
    poles = np.exp(np.linspace(-0.002, -0.015, n_sinusoids) + 1j * np.linspace(0.15, 0.9, n_sinusoids))
    sizes = rng.normal(size=(n_sinusoids, 3)) + 1j * rng.normal(size=(n_sinusoids, 3))
    return np.asarray(0.01 * (poles ** np.arange(N_STEPS)[:, None] @ sizes).real)


def arrived(p_loss: float, n_ahead: int, seed: int) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    known = np.random.default_rng(seed).random(N_STEPS) >= p_loss
    known[N_STEPS - n_ahead :] = False
    known[N_STEPS - n_ahead - 1] = True
    return known


@pytest.mark.parametrize(("n_sinusoids", "p_loss", "n_ahead"), [(1, 0.3, 1), (2, 0.1, 10), (2, 0.3, 10), (3, 0.2, 5)])
def test_a_movement_of_exactly_low_rank_is_completed(n_sinusoids: int, p_loss: float, n_ahead: int) -> None:
    y, known = damped_sinusoids(n_sinusoids, 1), arrived(p_loss, n_ahead, 2)
    path = np.where(known[:, None], y, 1e3)
    done = complete(path, known, NONE, 0.0, replace(EXACT, rank=2 * n_sinusoids))
    assert done.filled == pytest.approx(y, abs=1e-8)
    assert done.newest == pytest.approx(y[-N_ROWS:], abs=1e-8)
    assert done.n_turns < 300


def test_positions_that_were_struck_are_found_and_the_movement_goes_on_without_them() -> None:
    y, known, struck = damped_sinusoids(2, 3), arrived(0.1, 8, 4), [17, 40, 63]
    known[struck] = True
    path = y.copy()
    path[struck] += 0.02 * np.random.default_rng(5).normal(size=(3, 3))
    found = complete(path, known, NONE, 0.0, replace(EXACT, n_outliers=3, least_outlier_m=1e-6))
    assert np.flatnonzero(found.outliers).tolist() == struck
    assert found.filled == pytest.approx(y, abs=1e-7)
    # Without a sparse part they spoil the forecast.
    spoilt = complete(path, known, NONE, 0.0, EXACT)
    assert np.abs(spoilt.newest - y[-N_ROWS:]).max() > 1e-3


def test_factors_of_other_movements_complete_what_is_too_short_for_its_own() -> None:
    y, known = damped_sinusoids(2, 6), arrived(0.0, 10, 7)
    known[: N_STEPS - 22] = False
    windows = np.lib.stride_tricks.sliding_window_view(damped_sinusoids(2, 8), N_ROWS, axis=0)
    columns = windows.reshape(-1, N_ROWS)
    prior = columns.T @ columns / len(columns)
    path = np.where(known[:, None], y, 1e3)
    error, alone = (
        np.abs(complete(path, known, prior, weight, EXACT).newest[-1] - y[-1]).max() for weight in (1e6, 0.0)
    )
    assert error < 1e-6
    assert alone > 1e-3


def test_without_a_tolerance_to_reach_it_ends_after_the_turns_allowed() -> None:
    path = np.random.default_rng(9).normal(size=(N_STEPS, 3))
    known = arrived(0.2, 5, 9)
    for turns in (1, 4):
        done = complete(path, known, NONE, 0.0, replace(EXACT, tolerance_m=0.0, max_turns=turns))
        assert done.n_turns == turns
    assert complete(path, known, NONE, 0.0, replace(EXACT, tolerance_m=1e9)).n_turns == 1


def test_an_origin_elsewhere_moves_all_results_alike() -> None:
    y, known = np.cumsum(np.random.default_rng(10).normal(size=(N_STEPS, 3)), axis=0), arrived(0.2, 5, 10)
    numbers = replace(EXACT, ridge=1.0, max_turns=5)
    near, far = (complete(y + origin, known, np.eye(N_ROWS), 50.0, numbers) for origin in (0.0, 7.0))
    assert far.newest == pytest.approx(near.newest + 7.0, abs=1e-9)
    assert far.filled == pytest.approx(near.filled + 7.0, abs=1e-9)


def test_movements_together_are_completed_as_each_alone() -> None:
    paths = np.array([damped_sinusoids(2, seed) for seed in range(5)])
    paths[3, 40] += 0.02
    known = np.array([arrived(0.1 * seed, 2 + 3 * seed, seed) for seed in range(5)])
    priors = np.array([1e-5 * (seed + 1) * np.eye(N_ROWS) for seed in range(5)])
    numbers = replace(EXACT, n_outliers=2, least_outlier_m=1e-4, tolerance_m=1e-5, max_turns=60)
    together = complete_all(paths, known, priors, 3.0, numbers)
    assert len(set(together.n_turns)) > 2, "they end after different numbers of turns"
    assert together.outliers.any()
    for i in range(5):
        alone = complete(paths[i], known[i], priors[i], 3.0, numbers)
        assert together.n_turns[i] == alone.n_turns
        assert np.array_equal(together.outliers[i], alone.outliers)
        for name in ("newest", "filled", "left_m"):
            assert getattr(together, name)[i] == pytest.approx(getattr(alone, name), abs=1e-12), name


def test_the_fill_is_the_mean_of_each_antidiagonal() -> None:
    path, known = np.random.default_rng(11).normal(size=(12, 1)), np.ones(12, dtype=bool)
    numbers = replace(EXACT, rank=1, max_turns=1)
    done = complete(path, known, np.zeros((5, 5)), 0.0, numbers)
    columns = np.array([path[c : c + 5, 0] for c in range(8)]).T
    level = columns.mean(axis=0)
    left, values, right = np.linalg.svd(columns - level, full_matrices=False)
    low_rank = level + values[0] * np.outer(left[:, 0], right[0])
    means = [np.mean([low_rank[t - c, c] for c in range(8) if 0 <= t - c < 5]) for t in range(12)]
    assert done.left_m == pytest.approx(np.abs(path[:, 0] - means), abs=1e-9)
    assert done.newest[:, 0] == pytest.approx(low_rank[:, -1], abs=1e-9)


def test_moments_from_moves_are_those_of_the_columns() -> None:
    # A closed circle is steady: every row begins a column, and all moves over as many steps are equally long.
    angle = 2 * np.pi * np.arange(40) / 40
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    moves_m2 = np.array([float(np.mean((np.roll(circle, -n, axis=0) - circle) ** 2)) for n in range(9)])
    columns = np.array([np.roll(circle, -c, axis=0)[:9] for c in range(40)])
    columns = (columns - columns.mean(axis=1, keepdims=True)).transpose(1, 0, 2).reshape(9, -1)
    assert column_moments(moves_m2) == pytest.approx(columns @ columns.T / 80, abs=1e-12)


@given(seed=st.integers(0, 10_000), scale=st.sampled_from([0.0, 1e-9, 1e-3, 1e6]), p_loss=st.floats(0, 0.99))
@settings(max_examples=40, deadline=None)
def test_whatever_has_arrived_the_completion_is_finite(seed: int, scale: float, p_loss: float) -> None:
    rng = np.random.default_rng(seed)
    numbers = Factorisation(int(rng.integers(1, 28)), float(rng.choice([0.0, 1.0])), 5, 1e-3, 1e-12, 1e-6, 4)
    path, known = scale * rng.normal(size=(N_STEPS, 3)), arrived(p_loss, int(rng.integers(1, 25)), seed)
    done = complete(
        path, known, column_moments(1e-6 * np.arange(float(N_ROWS))), float(rng.choice([0.0, 100.0])), numbers
    )
    assert np.isfinite(done.newest).all()
    assert np.isfinite(done.filled).all()
    assert done.outliers.sum() <= 5
    assert not done.outliers[~known].any()
