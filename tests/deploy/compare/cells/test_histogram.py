import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.metrics.percentiles import summarise
from tis.deploy.compare.cells.sums import ERROR_WIDTH, histogram, merged, percentile

durations = st.lists(st.integers(1, 10**10), min_size=1, max_size=40)


@given(st.lists(durations, min_size=1, max_size=4), st.sampled_from([1, 50, 99]))
def test_percentiles_of_merged_counts_are_those_of_all_values_to_half_a_per_mille(
    parts: list[list[int]], percent: int
) -> None:
    counts = merged(histogram(np.array(part, dtype=np.int64)) for part in parts)
    everything = [value for part in parts for value in part]
    exact = summarise(everything, percentiles=(percent,))[f"p{percent}"]
    assert percentile(counts, percent) == pytest.approx(exact, rel=0.00051)
    assert sum(counts.values()) == len(everything)


def test_of_nothing_there_is_no_percentile_and_nothing_is_lost_below_a_nanosecond() -> None:
    assert percentile({}, 50) is None
    assert sum(histogram(np.array([0, -3, 1], dtype=np.int64)).values()) == 3


@given(durations)
def test_bins_of_errors_are_ten_times_as_wide_and_p100_is_the_largest(values: list[int]) -> None:
    counts = histogram(np.array(values, dtype=np.int64), ERROR_WIDTH)
    assert percentile(counts, 100, ERROR_WIDTH) == pytest.approx(max(values), rel=0.00501)
    assert sum(counts.values()) == len(values)
