from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.metrics.percentiles import summarise


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
