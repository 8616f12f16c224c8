import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binomtest

from tis.common.metrics.loss import wilson_interval


@settings(deadline=None, max_examples=60)
@given(st.integers(1, 10_000).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_wilson_interval_agrees_with_scipy(case: tuple[int, int]) -> None:
    n_lost, n = case
    interval = wilson_interval(n_lost, n)
    expected = binomtest(n_lost, n).proportion_ci(0.95, method="wilson")
    assert interval == pytest.approx((expected.low, expected.high), abs=1e-12)
    assert interval is not None
    assert 0 <= interval[0] <= n_lost / n <= interval[1] <= 1


def test_wilson_interval_knows_its_confidence_and_nothing_of_nothing() -> None:
    assert wilson_interval(0, 0) is None
    wide, narrow = wilson_interval(10, 100, 0.99), wilson_interval(10, 100, 0.5)
    assert wide is not None
    assert narrow is not None
    assert wide[0] < narrow[0] < 0.1 < narrow[1] < wide[1]
