from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.units import ms_to_ns, s_to_ns, sample_index, sample_instant_ns

rates = st.integers(1, 10_000)


def test_durations() -> None:
    assert s_to_ns(0.5) == 500_000_000
    assert ms_to_ns(33.4) == 33_400_000
    assert ms_to_ns(0.1) == 100_000
    assert s_to_ns(1e-10) == 0


def test_thirty_hertz_does_not_drift() -> None:
    assert [sample_instant_ns(i, 30) for i in range(4)] == [0, 33_333_333, 66_666_666, 100_000_000]
    assert sample_instant_ns(30 * 3600, 30) == 3600 * 10**9


@given(st.integers(0, 10**7), rates)
def test_an_instant_leads_back_to_its_sample(index: int, rate_hz: int) -> None:
    assert sample_index(sample_instant_ns(index, rate_hz), rate_hz) == index


@given(st.integers(0, 10**13), rates)
def test_the_index_is_the_nearest_sample(instant_ns: int, rate_hz: int) -> None:
    exact = Fraction(instant_ns * rate_hz, 10**9)
    assert abs(sample_index(instant_ns, rate_hz) - exact) <= Fraction(1, 2)


@pytest.mark.parametrize(("instant_ns", "index"), [(16_666_666, 0), (16_666_667, 1), (-1, 0)])
def test_the_border_between_two_samples(instant_ns: int, index: int) -> None:
    assert sample_index(instant_ns, 30) == index
