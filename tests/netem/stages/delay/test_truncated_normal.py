import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from tis.netem.stages.delay.laws import cdf_above, moments_above, quantile_above


@given(mean=st.floats(0, 1e9), std=st.floats(1e-3, 1e9), below=st.floats(0, 1e9))
def test_the_distribution_function_undoes_the_quantile_function(mean: float, std: float, below: float) -> None:
    u = np.array([1e-6, 0.25, 0.5, 0.999, 1 - 1e-9])
    x_ns = quantile_above(u, mean, std, mean - below)
    # where the spread is near the grain of floats about the mean, so is the quantile
    np.testing.assert_allclose(cdf_above(x_ns, mean, std, mean - below), u, atol=1e-9 + 1e-15 * (mean + below) / std)


def test_cdf_and_moments_are_those_of_scipy_beside_each_bound() -> None:
    bounds = np.array([-9.0, -3.0, -0.5, 0.0])
    mean_ns, variance = moments_above(0.0, 2.0, bounds)
    for bound, mean, spread in zip(bounds, mean_ns, variance, strict=True):
        law = stats.truncnorm(bound / 2, np.inf, 0, 2)
        assert (mean, spread) == pytest.approx((law.mean(), law.var()), rel=1e-9)
        x = np.linspace(bound - 1, 9, 30)
        np.testing.assert_allclose(cdf_above(x, 0.0, 2.0, bound), law.cdf(x), atol=1e-14)


def test_without_spread_the_distribution_is_a_step() -> None:
    assert cdf_above(np.array([4.9, 5.0]), 5.0, 1e-9, 0.0).tolist() == [0, 1]
    assert [array.tolist() for array in moments_above(5.0, 1e-9, np.array([0.0, 1.0]))] == [[5, 5], [0, 0]]
