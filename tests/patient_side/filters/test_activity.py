import numpy as np
import pytest

from tis.patient_side.filters.activity import ActivityMean


def test_it_is_the_mean_with_the_first_guess_weighed_in() -> None:
    mean, surprises = ActivityMean(60.0, 1800.0), np.random.default_rng(0).chisquare(3, 500) / 3
    now = mean.initial()
    for surprise in surprises:
        now = mean.after(now, float(surprise))
    assert now[0] == pytest.approx((60.0 + surprises.sum()) / 560.0)


def test_it_forgets_in_the_end() -> None:
    mean = ActivityMean(2.0, 50.0)
    now = mean.initial()
    for _ in range(1000):
        now = mean.after(now, 9.0)
    for _ in range(400):
        now = mean.after(now, 2.0)
    assert now[0] == pytest.approx(2.0, abs=0.01)


def test_one_jump_counts_no_more_than_thirty() -> None:
    mean = ActivityMean.at_rate(30)
    assert mean.after(mean.initial(), 1e12)[0] == pytest.approx((60.0 + 30.0) / 61.0)
