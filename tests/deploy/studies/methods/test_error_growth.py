"""Growth of errors: sums written by hand, and the interval by a loop over resamples."""

from math import sqrt
from typing import Any

import numpy as np
import pytest

from tis.deploy.compare.results.pooled import resampled
from tis.deploy.studies.methods.figures import error_growth


def hand(sse_mm2: float, n: int) -> dict[str, Any]:
    entry = {"sse_m2": [sse_mm2 * 1e-6, 0.0, 0.0], "n_missing": 0}
    return {
        "n_scored": n,
        "sst_m2": [1.0, 1.0, 1.0],
        "range_m": [0.1, 0.1, 0.1],
        "estimators": {"hold": entry, "arx_kf": entry},
    }


def test_it_is_the_ratio_of_root_mean_squares_over_all_ticks() -> None:
    here = {"C": [hand(36.0, 10), hand(0.0, 10)], "D": [hand(64.0, 20)]}
    there = {"C": [hand(10.0, 10)], "D": [hand(10.0, 10)]}
    found = error_growth(here, there, "arx_kf")
    assert found is not None
    assert found.ratio == pytest.approx(sqrt((100 / 40) / (20 / 20)))
    assert found.n_people == 2


def test_the_interval_resamples_the_same_people_on_both_sides() -> None:
    sse = {"C": (4.0, 1.0), "D": (9.0, 3.0), "E": (2.0, 2.0)}
    here = {who: [hand(one, 10)] for who, (one, _) in sse.items()}
    there = {who: [hand(other, 10)] for who, (_, other) in sse.items()}
    found = error_growth(here, there, "arx_kf")
    assert found is not None
    pairs = list(sse.values())
    again = [sqrt(sum(pairs[i][0] for i in draw) / sum(pairs[i][1] for i in draw)) for draw in resampled(3).tolist()]
    assert (found.low, found.high) == pytest.approx(tuple(np.percentile(again, [2.5, 97.5])))


def test_only_people_of_both_sides_count_and_one_has_no_interval() -> None:
    found = error_growth({"C": [hand(4.0, 1)], "D": [hand(9.0, 1)]}, {"C": [hand(1.0, 1)]}, "arx_kf")
    assert found == pytest.approx((2.0, None, None, 1))
    assert error_growth({"C": [hand(4.0, 1)]}, {}, "arx_kf") is None


def test_without_an_error_to_compare_with_there_is_no_growth() -> None:
    assert error_growth({"C": [hand(4.0, 1)]}, {"C": [hand(0.0, 1)]}, "arx_kf") is None
    assert error_growth({"C": [hand(4.0, 1)]}, {"C": [hand(0.0, 0)]}, "arx_kf") is None
