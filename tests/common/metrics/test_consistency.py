import numpy as np
import pytest
from scipy.stats import chi2

from tis.common.metrics.consistency import CHI2_3_95, consistency, mean_square_bounds, normalised_squares, region_pct

NAN = float("nan")


@pytest.mark.parametrize("n", [1, 7, 600, 12_345.5])
def test_bounds_are_quantiles_of_chi_squared(n: float) -> None:
    assert mean_square_bounds(n) == pytest.approx((chi2.ppf(0.025, n) / n, chi2.ppf(0.975, n) / n), rel=1e-9)


def test_the_radius_of_the_ellipsoid_is_the_root_of_a_quantile() -> None:
    assert pytest.approx(chi2.ppf(0.95, 3), rel=1e-12) == CHI2_3_95


def test_squares_of_a_table() -> None:
    error = np.array([[1.0, -4.0, 0.0], [NAN, 1.0, 1.0], [2.0, 0.0, 1.0]])
    std = np.array([[2.0, 2.0, 1.0], [1.0, 1.0, NAN], [0.0, 0.0, 1.0]])
    expected = [[0.25, 4.0, 0.0], [NAN, 1.0, NAN], [np.inf, 0.0, 1.0]]
    np.testing.assert_array_equal(normalised_squares(error, std), np.array(expected))


def test_honest_overconfident_and_modest_axes_are_told_apart() -> None:
    error = np.random.default_rng(5).normal(size=(2000, 3))
    found = consistency(normalised_squares(error, np.tile([1.0, 0.5, 2.0], (2000, 1))))
    assert found["n"] == 2000
    assert found["consistent"] == [True, False, False]
    assert found["mean"] == pytest.approx([1, 4, 0.25], rel=0.1)
    low, high = found["coverage_pct_interval_95"][0]
    assert low <= 95 <= high
    # 1.96 half deviations hold 67.3 %
    assert found["coverage_pct"][1] == pytest.approx(67.3, abs=3)
    assert found["coverage_pct"][2] > 99.9


def test_correlation_widens_the_bounds() -> None:
    generator = np.random.default_rng(6)
    alone = generator.normal(size=(3000, 3))
    together = np.repeat(generator.normal(size=(300, 3)), 10, axis=0)
    widths = [
        np.ptp(consistency(normalised_squares(error, np.ones((3000, 3))))["bounds_95"][0])
        for error in (alone, together)
    ]
    assert widths[1] > 2 * widths[0]


def test_a_certain_error_is_infinitely_inconsistent_and_no_rows_are_unknown() -> None:
    squares = normalised_squares(np.array([[1.0, 0.0, 0.0]]), np.zeros((1, 3)))
    found = consistency(squares)
    assert found["mean"] == [None, 0.0, 0.0]
    assert found["consistent"][0] is False
    assert found["coverage_pct"] == [0.0, 100.0, 100.0]
    assert consistency(np.full((4, 3), NAN))["mean"] == [None, None, None]


def test_the_region_of_normal_errors_holds_95_of_100() -> None:
    errors = np.random.default_rng(3).normal(size=(20_000, 3))
    found = region_pct(normalised_squares(2.0 * errors, np.full_like(errors, 2.0)))
    assert found == pytest.approx(95.0, abs=0.6)
    assert region_pct(normalised_squares(errors[:, :1], np.ones((20_000, 1)))) == pytest.approx(95.0, abs=0.6)
    assert region_pct(np.full((4, 3), np.nan)) is None
