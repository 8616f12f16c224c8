from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.metrics.etvo import Array, etvo, finer_grid_s, offset_grid_s


def movement(t_s: Array) -> Array:
    return 0.05 * np.column_stack([np.sin(2 * t_s), np.cos(3 * t_s), np.sin(t_s + 1)])


T = np.arange(300) / 30
GRID = offset_grid_s(-0.1, 0.3, 1 / 120)


def test_the_grid_reaches_both_ends_holds_zero_and_stays_small() -> None:
    assert GRID[0] == pytest.approx(-0.1)
    assert GRID[-1] == pytest.approx(0.3)
    assert 0.0 in GRID
    wide = offset_grid_s(-0.2, 1.0, 1e-5)
    assert len(wide) <= 256
    assert wide[0] <= -0.2
    assert wide[-1] >= 1.0


@given(st.lists(st.floats(-0.1, 0.3), min_size=1, max_size=5))
def test_a_finer_grid_holds_what_was_found_and_a_step_beyond(offsets_s: list[float]) -> None:
    found_s = GRID[np.abs(GRID - np.array(offsets_s)[:, None]).argmin(axis=1)]
    finer_s, step_s = finer_grid_s(GRID, found_s), GRID[1] - GRID[0]
    assert len(finer_s) <= 256
    assert [np.abs(finer_s - one).min() for one in found_s] == pytest.approx([0] * len(found_s), abs=1e-12)
    assert [finer_s[0], finer_s[-1]] == pytest.approx([found_s.min() - step_s, found_s.max() + step_s])
    assert np.diff(finer_s).max() <= step_s * (1 + 1e-9)


@pytest.mark.parametrize("late_s", [0.0, 0.1, -0.05, 0.25])
def test_a_delayed_copy_is_late_and_nothing_else(late_s: float) -> None:
    found = etvo(T, movement(T - late_s), movement(T), GRID)
    inner = slice(15, -15)  # the original stands still beyond its ends
    assert found.time_s[inner] == pytest.approx(late_s, abs=1e-9)
    assert found.value[inner].max() < 1e-4  # linear between samples
    assert found.delay_derivative == pytest.approx(0, abs=0.02)


def test_an_error_across_the_movement_is_no_delay() -> None:
    straight = np.column_stack([0.1 * T, 0 * T, 0 * T])
    found = etvo(T, straight + np.array([0, 0.002, 0]), straight, GRID)
    assert found.time_s.tolist() == [0.0] * 300
    assert found.value == pytest.approx(0.002)


def test_a_delay_that_jumps_is_followed_once() -> None:
    late_s = np.where(T < 5, 0.05, 0.2)
    found = etvo(T, movement(T - late_s), movement(T), GRID)
    assert np.median(found.time_s[30:140]) == pytest.approx(0.05, abs=1e-9)
    assert np.median(found.time_s[160:-15]) == pytest.approx(0.2, abs=1e-9)
    assert found.delay_derivative is not None
    assert found.delay_derivative >= 0.15 / T[-1]


def cost(path: tuple[int, ...], t: Array, made: Array, original: Array, grid: Array) -> float:
    speed = np.sqrt(np.mean(np.sum(np.diff(original, axis=0) ** 2, axis=1) / np.diff(t) ** 2))
    offsets = grid[list(path)]
    then = np.column_stack([np.interp(t - offsets, t, axis) for axis in original.T])
    return float(np.linalg.norm(made - then, axis=1).sum() + speed * np.abs(np.diff(offsets)).sum())


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10_000))
def test_no_path_is_better(seed: int) -> None:
    generator = np.random.default_rng(seed)
    t, grid = np.arange(5) / 10, np.array([-0.1, 0.0, 0.05, 0.2])
    original, made = generator.normal(size=(2, 5, 2))
    found = etvo(t, made, original, grid)
    path = tuple(int(np.flatnonzero(grid == offset)[0]) for offset in found.time_s)
    best = min(cost(other, t, made, original, grid) for other in product(range(4), repeat=5))
    assert cost(path, t, made, original, grid) == pytest.approx(best, rel=1e-9)


def test_too_little_to_align() -> None:
    assert etvo(np.empty(0), np.empty((0, 3)), np.empty((0, 3)), GRID).delay_derivative is None
    one = etvo(T[:1], np.ones((1, 3)), np.zeros((1, 3)), GRID)
    assert (one.value.tolist(), one.delay_derivative) == ([3**0.5], None)
