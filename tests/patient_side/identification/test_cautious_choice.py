import numpy as np
import pytest

from tests.patient_side.arm_models import random_command
from tis.patient_side.identification.direct_ls import Candidate, moments, most_cautious, random_walk, windows
from tis.patient_side.linear_system import Array

LAGS, HORIZONS = np.array([1, 2, 3]), np.array([1, 5, 10, 60])  # 60: most of a part of 72 rows
CANDIDATES = [Candidate(n, penalty) for n in (1, 3) for penalty in (0.01, 0.3, 10.0, 1000.0)]


def chosen(y: Array, n_parts: int) -> list[Candidate]:
    parts = moments([y], LAGS, HORIZONS, 1, n_parts)
    return most_cautious(parts, random_walk(parts[0].past, LAGS), CANDIDATES, HORIZONS)


def ridge(z: Array, t: Array, root: Array) -> Array:
    padded = np.vstack([z, np.sqrt(len(z)) * root])
    return np.asarray(np.linalg.lstsq(padded, np.vstack([t, np.zeros((len(root), 3))]))[0])


@pytest.mark.parametrize("seed", range(3))
def test_rows_left_out_one_part_after_another_give_the_same_choice(seed: int) -> None:
    y, n_parts = random_command(np.random.default_rng(seed), 351, 0.6, 1e-4), 4
    pasts, futures = windows([y], LAGS, HORIZONS, 1)
    parts = np.array_split(np.arange(len(pasts)), n_parts)
    walk = random_walk(pasts[parts[0]].T @ pasts[parts[0]] / len(parts[0]), LAGS)
    errors = np.empty((len(HORIZONS), len(CANDIDATES), n_parts))
    moves = np.empty((len(HORIZONS), len(CANDIDATES)))
    for j, steps in enumerate(HORIZONS.tolist()):
        t = futures[:, j]
        for c, candidate in enumerate(CANDIDATES):
            z = pasts[:, : 3 * candidate.n_lags]
            root = np.asarray(np.linalg.cholesky(candidate.penalty * walk[: z.shape[1], : z.shape[1]]).T)
            for i, part in enumerate(parts):
                left_out = np.concatenate(parts[max(0, i - 1) : i + 2]) if steps == 60 else part
                missed = t[part] - z[part] @ ridge(np.delete(z, left_out, 0), np.delete(t, left_out, 0), root)
                errors[j, c, i] = np.mean(np.sum(missed**2, axis=1)) / np.mean(np.sum(t**2, axis=1))
            moves[j, c] = np.sum((z @ ridge(z, t, root)) ** 2)
    for found, near, each_moves in zip(chosen(y, n_parts), ([0], [1, 2], [1, 2], [3]), moves, strict=True):
        averaged = errors[near].mean(axis=0)
        worse = averaged - averaged[averaged.mean(axis=1).argmin()]
        error = np.sqrt(np.sum((worse.T - worse.mean(axis=1)) ** 2, axis=0) / (n_parts * (n_parts - 1)))
        as_good = [c for c in range(len(CANDIDATES)) if worse[c].mean() <= error[c] / 2]
        assert found == CANDIDATES[min(as_good, key=lambda c: each_moves[c])]


def test_a_random_walk_is_held_and_a_velocity_that_lasts_is_not() -> None:
    rng = np.random.default_rng(5)
    walk = chosen(1e-4 * np.cumsum(rng.normal(size=(600, 3)), axis=0), 8)
    assert all(candidate.penalty >= 10.0 for candidate in walk)
    moving = chosen(random_command(rng, 600, 0.95, 1e-4), 8)
    assert all(candidate.penalty == 0.01 for candidate in moving[:3])


def test_a_part_without_rows_is_left_out() -> None:
    y = random_command(np.random.default_rng(1), 308, 0.6, 1e-4)
    (empty,) = moments([y[:3]], LAGS, HORIZONS, 1, 1)
    parts = moments([y], LAGS, HORIZONS, 1, 4)
    walk = random_walk(parts[0].past, LAGS)
    assert most_cautious([*parts, empty], walk, CANDIDATES, HORIZONS) == chosen(y, 4)
