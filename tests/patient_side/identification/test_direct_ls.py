from functools import cache

import numpy as np
import pytest

from tests.patient_side.arm_models import random_command
from tis.common.errors import DataError
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise
from tis.patient_side.identification.direct_ls import fit_direct, random_walk, regression, windows
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import DirectModel


def movement(n_rows: int, seed: int) -> Array:
    return random_command(np.random.default_rng(seed), n_rows, 0.9, 1e-4)


def test_steps_stay_a_thirtieth_of_a_second_at_higher_rates() -> None:
    slow = movement(600, 2)
    fast = np.repeat(slow, 4, axis=0)[: 4 * 600 - 3]
    at_120 = fit_direct([fast], 120)
    assert at_120.stride == 4
    assert np.array_equal(at_120.lags, fit_direct([slow], 30).lags)


def test_of_noise_nothing_is_concluded_from_long_ago() -> None:
    rng = np.random.default_rng(3)
    walk = fit_direct([1e-4 * np.cumsum(rng.normal(size=(1200, 3)), axis=0)], 30)
    weights, _ = regression(walk, random_walk(walk.past, walk.lags), walk.penalty[4], 4, slice(3 * walk.n_lags[4]))
    kept = len(weights)
    moved = np.trace(weights.T @ walk.past[:kept, :kept] @ weights) / np.trace(walk.future[4])  # mean squares
    assert np.sqrt(moved) < 0.1


def squares(model: DirectModel, scored_on: Array, horizon_steps: int) -> tuple[float, float]:
    """Return the sums of squares of the errors of forecasts and of hold, so many steps ahead."""
    j = int(np.searchsorted(model.horizons, horizon_steps))
    assert model.horizons[j] == horizon_steps
    pasts, futures = windows([scored_on], model.lags, model.horizons, 1)
    walk, kept = random_walk(model.past, model.lags), slice(3 * int(model.n_lags[j]))
    weights, _ = regression(model, walk, float(model.penalty[j]), j, kept)
    return float(np.sum((futures[:, j] - pasts[:, kept] @ weights) ** 2)), float(np.sum(futures[:, j] ** 2))


@cache
def walk_after_head(seed: int) -> tuple[DirectModel, Array]:
    """Return a model of the first 1240 rows of a random walk, and the others."""
    walk = 1e-4 * np.cumsum(np.random.default_rng(seed).normal(size=(4240, 3)), axis=0)
    return fit_direct([walk[:1240]], 30), walk[1240:]


@cache
def hands_after_head(seed: int) -> tuple[DirectModel, Array]:
    """Return a model of the first 1240 rows of an arm that a synthetic surgeon drives, and the others."""
    source = SyntheticSource(kind="synthetic", hands=("left",), movement_s=1.2, pause_s=0.8)
    y = synthesise(source, seed, 30, 4240, 0).hands[0].follower.position_m
    return fit_direct([y[:1240]], 30), y[1240:]


@pytest.mark.parametrize("steps", [30, 60, 120, 150])
def test_a_short_head_of_a_random_walk_leaves_hold(steps: int) -> None:
    for seed in range(4):
        missed, held = squares(*walk_after_head(seed), steps)
        assert np.sqrt(missed / held) < 1.01


@pytest.mark.parametrize("steps", [1, 30, 60, 90, 120, 150])
def test_a_short_head_of_hands_is_worth_no_less_than_hold(steps: int) -> None:
    missed, held = 0.0, 0.0
    for seed in range(1, 5):
        both = squares(*hands_after_head(seed), steps)
        assert both[0] < 1.1 * both[1]
        missed, held = missed + both[0], held + both[1]
    assert np.sqrt(missed / held) < (0.45 if steps == 1 else 1.02)


def test_too_few_rows_are_refused() -> None:
    with pytest.raises(DataError, match="direct_ls needs"):
        fit_direct([movement(7, 0)], 30)
    fit_direct([movement(60, 0)], 30)


def test_the_trials_are_not_modified() -> None:
    y = movement(300, 5)
    before = y.copy()
    y.flags.writeable = False
    fit_direct([y], 30)
    assert np.array_equal(y, before)
