import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.netem.stages.delay.shifted import Hyperexponential


def _bisected(law: Hyperexponential, p: float) -> float:
    """The root of sum w e^(-x / m) = 1 - p, found by halving alone."""
    weights, means_ns = np.array(law.weights), np.array(law.means_ns)
    low, high = 0.0, 40 * max(law.means_ns)
    for _ in range(200):
        x = (low + high) / 2
        low, high = (x, high) if (weights * np.exp(-x / means_ns)).sum() > 1 - p else (low, x)
    return high


@settings(deadline=None, max_examples=200)
@given(
    parts=st.lists(st.tuples(st.floats(1e-9, 1), st.floats(1, 3.6e12)), min_size=1, max_size=6),
    p=st.floats(1e-6, 1 - 2.0**-40),
)
def test_the_quantile_is_the_root_that_bisection_finds(parts: list[tuple[float, float]], p: float) -> None:
    total = sum(weight for weight, _ in parts)
    law = Hyperexponential(tuple(weight / total for weight, _ in parts), tuple(mean_ns for _, mean_ns in parts))
    # where P(X > x) is nearly 1 a rounding error of it is one of 1e-16 times the longest mean
    expected = pytest.approx(_bisected(law, p), rel=1e-9, abs=1e-14 * max(law.means_ns))
    assert law.quantile_ns(np.array([p]))[0] == expected


def test_a_short_delay_beside_very_long_ones_is_exact() -> None:
    """The root lies a trillionth of the longest mean from 0; by hand only the parts of 1, 15, 85 and 144 ns count."""
    weights, means_ns = np.array([1, 1, 0.5, 0.5, 0.6875]) / 3.6875, (85.0, 144.0, 15.0, 2325842349333.0, 1.0)
    law = Hyperexponential(tuple(weights.tolist()), means_ns)
    x_ns = law.quantile_ns(np.array([0.125]))
    assert law.cdf(x_ns) == pytest.approx(0.125, rel=1e-12)


def test_of_one_part_it_is_exponential() -> None:
    p = np.array([1e-3, 0.3, 0.999999, 1 - 2.0**-53])
    np.testing.assert_allclose(Hyperexponential((1.0,), (5e6,)).quantile_ns(p), -5e6 * np.log1p(-p), rtol=1e-11)
