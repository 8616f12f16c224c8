import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.metrics.percentiles import summarise
from tis.common.metrics.queue_depth import queue_depth


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
