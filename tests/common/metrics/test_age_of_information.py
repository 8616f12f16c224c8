import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.metrics.age_of_information import age_of_information
from tis.common.metrics.tick_phase import Arrivals


def test_a_saw_tooth_worked_by_hand() -> None:
    # sampled at 0, 10, 20; arrived at 4, 16, 22; until 30: ages 4..16, 6..12, 2..10, areas 12*10, 6*9, 8*6
    arrivals = Arrivals(np.array([4, 16, 22]), np.array([0, 10, 20]))
    found = age_of_information(arrivals, 30)
    assert found.mean_ns == pytest.approx((120 + 54 + 48) / 26)
    assert found.peaks_ns.tolist() == [16, 12]


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), max_size=12), st.integers(0, 90))
def test_the_mean_is_that_of_the_age_at_every_half_ns(pairs: list[tuple[int, int]], until: int) -> None:
    arrivals = Arrivals.of(*np.array([(s + d, s) for s, d in pairs], dtype=np.int64).reshape(-1, 2).T)
    found = age_of_information(arrivals, until)
    first = int(arrivals.recv_ns[0]) if len(pairs) else until
    ages = [
        t + 0.5 - max(s for r, s in zip(*map(np.ndarray.tolist, arrivals), strict=True) if r <= t)
        for t in range(first, until)
    ]
    assert found.mean_ns == (pytest.approx(np.mean(ages)) if ages else None)
