import numpy as np

from tis.common.metrics.timing import lateness_us, tick_summary


def test_a_missed_tick_counts_but_is_not_late() -> None:
    due = np.array([2_000_000, 35_333_333, 68_666_666, 102_000_000], dtype=np.int64)
    begin = np.array([2_010_000, 35_353_333, 102_030_000, 102_030_000], dtype=np.int64)
    missed = np.array([False, False, True, False])
    assert tick_summary(30, due, begin, missed) == {
        "rate_hz": 30,
        "count": 4,
        "missed": 1,
        "lateness_us": {"p50": 20.0, "p95": 30.0, "p99": 30.0, "max": 30.0},
    }


def test_a_run_without_ticks() -> None:
    none = np.empty(0, dtype=np.int64)
    summary = tick_summary(30, none, none, np.empty(0, dtype=np.bool_))
    assert (summary["count"], summary["missed"]) == (0, 0)
    assert summary["lateness_us"] == {"p50": None, "p95": None, "p99": None, "max": None}


def test_early_is_negative() -> None:
    assert lateness_us(np.array([5_000]), np.array([3_500]))["max"] == -1.5
