"""Exponents: known ones, the interval's coverage, and what a constant cost or a single size gives."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.deploy.studies.methods.figures import fit_power_law

SIZES = (100.0, 200.0, 400.0, 800.0, 1600.0)


@pytest.mark.parametrize("exponent", [0.0, 1.0, 2.0, 3.0, -0.5])
def test_an_exact_power_has_its_exponent_and_an_interval_of_no_width(exponent: float) -> None:
    found = fit_power_law(SIZES, [7.0 * size**exponent for size in SIZES])
    assert found is not None
    assert found.n == 5
    assert (found.exponent, found.low, found.high) == pytest.approx((exponent,) * 3, abs=1e-9)


def test_a_doubling_from_100_to_200_is_an_exponent_of_one_without_interval() -> None:
    assert fit_power_law((100, 200), (3.0, 6.0)) == pytest.approx((1.0, None, None, 2), abs=1e-12)
    assert fit_power_law((100, 100, 200), (3.0, 3.0, 6.0)) == pytest.approx((1.0, None, None, 3), abs=1e-12)


def test_one_size_or_none_gives_nothing() -> None:
    assert fit_power_law((100, 100), (3.0, 6.0)) is None
    assert fit_power_law((), ()) is None


def test_a_hand_worked_regression_has_its_interval() -> None:
    """Logs (0, 0), (1, 2), (2, 2): slope 1, residuals -1/3, 2/3, -1/3; t(1) = 12.706, so 1 +- 12.706 sqrt(1/3)."""
    found = fit_power_law([float(np.exp(x)) for x in (0, 1, 2)], [float(np.exp(y)) for y in (0, 2, 2)])
    assert found is not None
    margin = 12.706204736 * np.sqrt(6 / 9 / 1 / 2)
    assert (found.exponent, found.low, found.high) == pytest.approx((1.0, 1 - margin, 1 + margin), rel=1e-6)


def test_the_interval_covers_the_exponent_in_95_of_100_draws() -> None:
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(2000):
        found = fit_power_law(SIZES, [size**1.5 * np.exp(rng.normal(0, 0.3)) for size in SIZES])
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        inside += found.low <= 1.5 <= found.high
    assert abs(inside / 2000 - 0.95) < 0.015


@given(st.lists(st.floats(1e-3, 1e3), min_size=3, max_size=8), st.floats(1e-3, 1e3), st.floats(1e-3, 1e3))
def test_units_of_size_and_cost_do_not_matter(costs: list[float], of_size: float, of_cost: float) -> None:
    sizes = [2.0**i for i in range(len(costs))]
    one = fit_power_law(sizes, costs)
    other = fit_power_law([of_size * size for size in sizes], [of_cost * cost for cost in costs])
    assert one == pytest.approx(other, rel=1e-6, abs=1e-6)
