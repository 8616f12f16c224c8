"""Bounds that chance keeps to: exact where there is an exact test, simulated otherwise."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest, norm

from tis.common.metrics.fidelity import (
    LEVEL,
    batch_inflation,
    gilbert_inflation,
    half_life_inflation,
    is_decidable,
    mean_margin,
    share_bounds,
)


def test_the_level_is_that_of_four_standard_errors() -> None:
    assert pytest.approx(2 * norm.sf(4), rel=1e-9) == LEVEL


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 100_000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_share_bounds_are_those_of_the_exact_test(case: tuple[int, int]) -> None:
    expected = binomtest(*case).proportion_ci(1 - LEVEL, method="exact")
    assert share_bounds(*case) == pytest.approx((expected.low, expected.high), rel=1e-6, abs=1e-12)


def test_a_share_is_decidable_once_none_at_all_would_be_a_surprise() -> None:
    """0.99 ** n < LEVEL / 2 = 3.17e-5 from n = 1031 on."""
    assert not is_decidable(0.01, 1030)
    assert is_decidable(0.01, 1031)
    assert is_decidable(0.0, 1)
    assert is_decidable(1.0, 1)
    assert not is_decidable(0.0, 0)
    assert share_bounds(0, 1031)[1] < 0.0102
    assert share_bounds(0, 1030)[1] > 0.01


@pytest.mark.parametrize("n", [30, 1000])
def test_the_margin_of_a_mean_holds_for_skewed_draws_too(n: int) -> None:
    """Exponential draws, whose means are gamma: fewer than one in 15 000 lies above the margin."""
    from scipy.stats import gamma

    above = gamma.sf(n * (1 + mean_margin(1.0, 2.0, n)), n)
    assert 1e-6 < above < 6e-5
    assert gamma.sf(n * (1 + mean_margin(1.0, 0.0, n)), n) > above


def test_bursts_inflate_as_a_simulated_chain_shows() -> None:
    p_loss, burst, n = 0.1, 5.0, 400_000
    r = 1 / burst
    p = r * p_loss / (1 - p_loss)
    u = np.random.default_rng(3).random(n).tolist()
    lost, now = [], False
    for draw in u:
        now = draw >= r if now else draw < p
        lost.append(now)
    means = np.array(lost, dtype=float).reshape(-1, 1000).mean(axis=1)
    measured = means.var(ddof=1) * 1000 / (p_loss * (1 - p_loss))
    assert gilbert_inflation(p_loss, burst) == pytest.approx(measured, rel=0.2)
    assert batch_inflation(np.array(lost) - p_loss, p_loss * (1 - p_loss)) == pytest.approx(measured, rel=0.35)
    assert gilbert_inflation(p_loss, 1 / (1 - p_loss)) == pytest.approx(1)
    assert gilbert_inflation(0.0, 0.0) == 1
    assert gilbert_inflation(1.0, float("inf")) == float("inf")


def test_a_half_life_inflates_as_a_simulated_process_shows() -> None:
    step_s, half_life_s, n = 0.01, 0.05, 400_000
    rho = 0.5 ** (step_s / half_life_s)
    normal = np.random.default_rng(4).standard_normal(n).tolist()
    x, process = 0.0, []
    for draw in normal:
        x = rho * x + (1 - rho**2) ** 0.5 * draw
        process.append(x)
    measured = 2000 * np.array(process).reshape(-1, 2000).mean(axis=1).var(ddof=1)
    assert half_life_inflation(step_s, half_life_s) == pytest.approx(measured, rel=0.25)
    assert half_life_inflation(1000.0, 0.05) == 1


def test_independent_residuals_inflate_nothing_and_few_are_not_asked() -> None:
    noise = np.random.default_rng(5).standard_normal(100_000)
    assert batch_inflation(noise, 1.0) < 1.6
    assert batch_inflation(np.repeat(noise[:10], 39), 1.0) == 1.0
