"""Sums of errors: values by hand, sums of parts, and the way through JSON."""

import json

import numpy as np
import pytest

from tis.deploy.compare.cells.forecasts import ErrorSums

# two forecasts of two samples ahead
ERRORS_M = np.array([[[3.0, 4.0, 0.0], [0.0, 0.0, -2.0]], [[0.0, 0.0, 1.0], [2.0, -3.0, 6.0]]])


def test_sums_are_over_forecasts_for_each_number_of_samples_ahead() -> None:
    sums = ErrorSums.of(ERRORS_M)
    assert sums.n == 2
    assert sums.distance_m.tolist() == [5.0 + 1.0, 2.0 + 7.0]
    assert sums.absolute_m.tolist() == [[3.0, 4.0, 1.0], [2.0, 3.0, 8.0]]
    assert sums.squares_m2.tolist() == [[9.0, 16.0, 1.0], [4.0, 9.0, 40.0]]


def test_the_total_of_parts_is_that_of_all_errors_together() -> None:
    total = ErrorSums.total(ErrorSums.of(ERRORS_M[i : i + 1]) for i in range(2))
    assert total is not None
    assert total.to_json() == ErrorSums.of(ERRORS_M).to_json()
    assert ErrorSums.total([]) is None


def test_sums_come_back_from_json() -> None:
    sums = ErrorSums.of(ERRORS_M)
    again = ErrorSums.from_json(json.loads(json.dumps(sums.to_json())))
    assert again.to_json() == pytest.approx(sums.to_json())
