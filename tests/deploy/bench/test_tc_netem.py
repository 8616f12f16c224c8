from math import sqrt

import numpy as np
import pytest

from deploy.bench.tc_netem import correlated_uniforms, jitter

N = 400_000
U = np.random.default_rng(2).random(N)


def _neighbours(x: np.ndarray) -> float:
    return float(np.corrcoef(x[1:], x[:-1])[0, 1])


def test_the_recipe_by_hand() -> None:
    x = correlated_uniforms(np.array([0.8, 0.4, 0.0]), 0.25)
    np.testing.assert_allclose(x, [0.8, 0.75 * 0.4 + 0.25 * 0.8, 0.25 * 0.5])
    assert correlated_uniforms(np.array([]), 0.25).tolist() == []


@pytest.mark.parametrize("rho", [0.0, 0.25, 0.9])
def test_mixing_uniforms_shrinks_the_jitter_and_moves_nothing(rho: float) -> None:
    delay_ms = jitter(50.0, 10.0, correlated_uniforms(U, rho))
    asked_ms = 10 / sqrt(3)
    assert delay_ms.std() / asked_ms == pytest.approx(sqrt((1 - rho) / (1 + rho)), rel=0.01)
    assert delay_ms.mean() == pytest.approx(50, abs=0.1)
    assert _neighbours(delay_ms) == pytest.approx(rho, abs=0.01)


def test_a_quarter_of_correlation_leaves_0_775_of_the_jitter() -> None:
    delay_ms = jitter(50.0, 10.0, correlated_uniforms(U, 0.25))
    assert delay_ms.std() / (10 / sqrt(3)) == pytest.approx(0.775, abs=0.005)


def test_reduced_modulo_the_jitter_is_whole_and_the_correlation_gone() -> None:
    """What the page says of kernels that take a 32-bit number modulo twice the jitter: it wraps around many times."""
    jitter_ns = 10_000_000
    delay_ns = np.floor(correlated_uniforms(U, 0.25) * 2.0**32) % (2 * jitter_ns) - jitter_ns + 50_000_000
    assert delay_ns.std() / (jitter_ns / sqrt(3)) == pytest.approx(1, abs=0.01)
    assert _neighbours(delay_ns) == pytest.approx(0, abs=0.01)
