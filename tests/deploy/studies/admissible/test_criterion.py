"""The bound over persons: by its coverage of drawn samples, and against Student's interval of scipy."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.stats import ttest_1samp

from tis.deploy.studies.admissible.criterion import Limit, bound_of, upper_bound

N_PERSONS = 8
N_SAMPLES = 6000


def student(values: np.ndarray) -> np.ndarray:
    """Return the bound of each row."""
    return np.asarray(ttest_1samp(values, 0.0, axis=-1, alternative="less").confidence_interval(0.95).high)


def coverage(bound: object, drawn: np.ndarray, mean: float) -> float:
    assert callable(bound)
    return float(np.mean([bound(values) >= mean for values in drawn]))


@pytest.mark.parametrize(
    ("draw", "mean"),
    [
        (lambda rng, size: np.exp(0.5 * rng.normal(size=size)), np.exp(0.125)),
        (lambda rng, size: np.exp(0.8 * rng.normal(size=size)), np.exp(0.32)),
        (lambda rng, size: rng.gamma(2.0, size=size), 2.0),
        (lambda rng, size: rng.gamma(1.0, size=size), 1.0),
    ],
    ids=["lognormal 0.5", "lognormal 0.8", "gamma 2", "gamma 1"],
)
def test_of_eight_skewed_persons_the_bound_holds_more_often_than_students(draw: object, mean: float) -> None:
    assert callable(draw)
    drawn = draw(np.random.default_rng(4), (N_SAMPLES, N_PERSONS))
    ours, theirs = coverage(upper_bound, drawn, mean), float(np.mean(student(drawn) >= mean))
    assert ours > 0.84
    assert ours > theirs + 0.01
    assert abs(0.95 - ours) < 0.8 * abs(0.95 - theirs)


def test_of_normal_persons_it_holds_95_times_of_100() -> None:
    drawn = 5 + np.random.default_rng(4).normal(size=(N_SAMPLES, N_PERSONS))
    assert 0.945 <= coverage(upper_bound, drawn, 5.0) <= 0.975


@given(arrays(np.float64, st.integers(2, 12), elements=st.floats(0.1, 100)), st.floats(0.01, 100))
def test_it_is_never_below_students_and_keeps_the_unit(values: np.ndarray, unit: float) -> None:
    bound = upper_bound(values)
    if np.ptp(values) > 1e-3:
        assert bound >= student(values) - 1e-9 * abs(bound)
    assert upper_bound(unit * values) == pytest.approx(unit * bound, rel=1e-6)
    assert bound >= values.mean() - 1e-12 * abs(bound)


def test_the_bound_grows_smoothly_with_figures_of_four_persons() -> None:
    first, last = np.array([1.28, 0.46, 0.6, 0.94]), np.array([1.58, 0.52, 0.75, 1.39])
    bounds = [upper_bound((first + share * (last - first)) ** 2) ** 0.5 for share in np.linspace(0, 1, 50)]
    assert np.diff(bounds).min() > 0
    assert np.diff(bounds).max() < 0.02


def test_equal_persons_leave_no_doubt() -> None:
    assert upper_bound(np.full(4, 3.0)) == 3.0


def test_errors_are_bounded_by_squares_and_shares_as_they_are() -> None:
    figures = [1.0, 2.0, 4.0]
    squares = upper_bound(np.array(figures) ** 2)
    assert bound_of(Limit("rmse_3d_mm", True, 9.0), figures) == pytest.approx(squares**0.5)
    assert bound_of(Limit("loss_pct", True, 9.0), figures) == pytest.approx(upper_bound(np.array(figures)))
    lower = bound_of(Limit("coverage_pct", False, 90.0), [94.0, 95.0, 96.5])
    assert lower == pytest.approx(-upper_bound(-np.array([94.0, 95.0, 96.5])))
    assert lower < 94.0


def test_an_unknown_figure_holds_no_limit() -> None:
    limit = Limit("rmse_3d_mm", True, 2.0)
    assert limit.margin(bound_of(limit, [1.0, 1.1, 1.2])) < 0
    assert limit.margin(bound_of(limit, [1.0, float("nan"), 1.0])) == float("inf")
    assert limit.margin(bound_of(limit, [1.0, 1.1, 1.2], [1.0, float("nan")])) == float("inf")


@pytest.mark.parametrize(("of_persons", "of_draws"), [(1.0, 1.0), (0.2, 1.0), (1.0, 0.0)])
def test_draws_that_all_persons_share_count_as_well(of_persons: float, of_draws: float) -> None:
    """Figures of 4 persons and 4 seeds, with an effect of each person, of each draw, and of both together."""
    rng = np.random.default_rng(5)
    persons, draws = of_persons * rng.normal(size=(4000, 4, 1)), of_draws * rng.normal(size=(4000, 1, 4))
    figures = 10 + persons + draws + 0.2 * rng.normal(size=(4000, 4, 4))
    limit = Limit("age_mean_ms", True, 1.0)
    bounds = [bound_of(limit, list(each.mean(axis=1)), list(each.mean(axis=0))) for each in figures]
    assert 0.93 <= np.mean(np.array(bounds) >= 10.0) <= 0.99
    if of_draws > of_persons:
        alone = [bound_of(limit, list(each.mean(axis=1))) for each in figures]
        assert np.mean(np.array(alone) >= 10.0) < 0.75
