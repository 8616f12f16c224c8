from fractions import Fraction
from statistics import median_low

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.metrics.percentiles import is_resolvable, median, queue_depth, summarise, uncertainties


def edf_percentile(values: list[float], p: Fraction) -> float:
    """Count it out: the smallest value whose share of values at or below it reaches p per cent."""
    return min(v for v in values if Fraction(sum(w <= v for w in values), len(values)) >= p / 100)


def test_table_of_twenty() -> None:
    values = np.arange(20.0, 0.0, -1.0)
    assert summarise(values, (50, 95, 99), ("mean", "std", "max")) == {
        "mean": 10.5,
        "std": pytest.approx(np.sqrt((20**2 - 1) / 12)),  # of the discrete uniform distribution on 1..20
        "p50": 10.0,
        "p95": 19.0,
        "p99": 20.0,
        "max": 20.0,
    }


def test_names_and_order_are_those_asked_for() -> None:
    assert list(summarise([1.0, 2.0])) == ["p50", "p95", "p99", "max"]
    assert list(summarise([1.0], (50, 99), ())) == ["p50", "p99"]
    assert list(summarise([1.0], (50,), ("max", "std", "mean"))) == ["mean", "std", "p50", "max"]


def test_nothing_is_interpolated() -> None:
    assert summarise([0.0, 1000.0], (50,), ())["p50"] == 0.0


@given(st.lists(st.floats(-1e9, 1e9), min_size=1, max_size=20))
def test_a_median_in_words_is_the_p50_of_the_tables(values: list[float]) -> None:
    assert median(values) == median_low(values) == summarise(values, (50,), ())["p50"]
    with pytest.raises(ValueError, match="no values"):
        median([])


def test_empty_is_null_and_not_nan() -> None:
    assert set(summarise([], (50, 95), ("mean", "std", "max")).values()) == {None}


def test_one_value_is_every_statistic() -> None:
    assert summarise([3.0], (50, 99), ("mean", "std", "max")) == {
        "mean": 3.0,
        "std": 0.0,
        "p50": 3.0,
        "p99": 3.0,
        "max": 3.0,
    }


@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_non_finite_values_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="finite"):
        summarise([1.0, bad])


@settings(deadline=None, max_examples=100)
@given(st.lists(st.integers(-50, 50).map(float), min_size=1, max_size=120), st.integers(1, 1000))
def test_is_the_empirical_distribution_function_inverted(values: list[float], p_per_mille: int) -> None:
    p = Fraction(p_per_mille, 10)
    assert summarise(values, (float(p),), ())[f"p{float(p):g}"] == edf_percentile(values, p)


def test_the_tail_has_a_name_of_its_own() -> None:
    assert summarise(np.arange(1, 2001), (99, 99.9), ()) == {"p99": 1980.0, "p99.9": 1998.0}


def test_depths_count_for_as_long_as_they_held() -> None:
    at_ns, depth = np.array([100, 110, 150, 190]), np.array([0, 8, 2, 4])
    # 10 ns of 0, 40 of 8, 40 of 2, 10 of 4: 440 / 100
    assert queue_depth(at_ns, depth, 200, (10, 50, 60, 95)) == {
        "mean": 4.4,
        "p10": 0.0,
        "p50": 2.0,
        "p60": 4.0,
        "p95": 8.0,
        "max": 8.0,
    }


def test_a_depth_that_was_replaced_at_once_counts_for_the_maximum_only() -> None:
    found = queue_depth(np.array([5, 5, 5]), np.array([1, 9, 3]), 6, (50, 99))
    assert found == {"mean": 3.0, "p50": 3.0, "p99": 3.0, "max": 9.0}


def test_without_samples_or_time_there_is_no_mean() -> None:
    none = np.array([], dtype=np.int64)
    assert queue_depth(none, none, 10) == {"mean": None, "p50": None, "p95": None, "p99": None, "max": None}
    found = queue_depth(np.array([10]), np.array([3]), 10)
    assert found == {"mean": None, "p50": None, "p95": None, "p99": None, "max": 3.0}


@pytest.mark.parametrize(("at_ns", "until_ns"), [([1, 3, 2], 9), ([1, 2, 3], 2)])
def test_time_does_not_run_back(at_ns: list[int], until_ns: int) -> None:
    with pytest.raises(ValueError, match="ascend"):
        queue_depth(np.array(at_ns), np.array([1, 1, 1]), until_ns)


def test_a_year_of_gigabytes_does_not_overflow() -> None:
    year_ns = 31_536_000 * 10**9
    found = queue_depth(np.array([0, year_ns // 2]), np.array([10**9, 3 * 10**9]), year_ns, (50, 99))
    assert found == {"mean": pytest.approx(2e9), "p50": 1e9, "p99": 3e9, "max": 3e9}


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 6)), min_size=1, max_size=15), st.integers(1, 20))
def test_is_the_summary_of_the_depth_at_each_nanosecond(steps: list[tuple[int, int]], last_ns: int) -> None:
    at_ns = 1_000 + np.cumsum([gap for gap, _ in steps])
    depth = np.array([n for _, n in steps])
    until_ns = int(at_ns[-1]) + last_ns
    each_ns = [depth[np.flatnonzero(at_ns <= ns)[-1]] for ns in range(int(at_ns[0]), until_ns)]
    expected = summarise(each_ns, (1, 50, 95, 99, 100), ("mean",))
    found = queue_depth(at_ns, depth, until_ns, (1, 50, 95, 99, 100))
    assert found.pop("max") == depth.max()
    assert found == pytest.approx(expected)


@given(st.lists(st.tuples(st.integers(0, 100), st.integers(0, 30)), min_size=1, max_size=60), st.integers(0, 2**32))
@settings(max_examples=100)
def test_the_figure_of_the_true_values_lies_within_its_uncertainty(pairs: list[tuple[int, int]], seed: int) -> None:
    """The true values are drawn within the uncertainty of the measured ones."""
    measured, open_ = np.array(pairs, dtype=float).T
    true = measured + open_ * np.random.default_rng(seed).uniform(-1, 1, len(measured))
    names = {"percentiles": (5, 50, 95, 99), "also": ("mean", "max")}
    found, right = (summarise(values, **names) for values in (measured, true))  # type: ignore[arg-type]
    bounds = uncertainties(measured, open_, **names)  # type: ignore[arg-type]
    assert bounds.keys() == found.keys()
    for name, bound in bounds.items():
        value, expected = found[name], right[name]
        assert value is not None and expected is not None and bound is not None  # noqa: PT018
        assert abs(value - expected) <= bound + 1e-9


def test_worked_on_paper() -> None:
    """Of 10, 20 and 30 the middle one may be off by 15: it can be the largest, and the median by 10 less."""
    assert uncertainties([10, 20, 30], [0, 15, 0], percentiles=(50,)) == {"p50": 10, "max": 5}
    assert uncertainties([], []) == {"p50": None, "p95": None, "p99": None, "max": None}


def test_what_is_open_by_more_than_its_size_is_not_resolvable() -> None:
    assert is_resolvable(12.41, 0.08)
    assert is_resolvable(0.08, 0.08)
    assert not is_resolvable(0.05, 0.08)
    assert not is_resolvable(-0.05, 0.08)  # an arrival before the sending
    assert is_resolvable(None, 0.08)
    assert is_resolvable(0.0, 0.0)
    assert is_resolvable(1.0, None)
