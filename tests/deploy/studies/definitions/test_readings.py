"""Readings of an error: values by hand, and the order of the readings for any errors."""

from math import sqrt

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.deploy.compare.cells.forecasts import ErrorSums
from tis.deploy.studies.definitions.readings import (
    ERRORS,
    HORIZONS_S,
    N_AHEAD,
    READINGS,
    SPANS,
    Reading,
    steps_of,
    value_mm,
)


def _sums(first_three_m: list[list[float]]) -> ErrorSums:
    """Return one forecast with these errors 1, 2 and 3 samples ahead, and none later."""
    errors = np.zeros((1, N_AHEAD, 3))
    errors[0, :3] = first_three_m
    return ErrorSums.of(errors)


def test_spans_hold_the_steps_of_their_rate() -> None:
    assert steps_of("at", 0.1) == [3]
    assert steps_of("up_to_30_hz", 0.1) == [1, 2, 3]
    assert steps_of("up_to_10_hz", 0.5) == [3, 6, 9, 12, 15]
    assert N_AHEAD == 60
    assert {steps_of(span, horizon)[-1] for span in SPANS for horizon in HORIZONS_S} == {3, 15, 30, 60}


def test_errors_are_those_computed_by_hand() -> None:
    sums = _sums([[0.001, 0.0, 0.0], [0.0, 0.002, 0.0], [0.003, 0.004, 0.0]])
    at = [value_mm(sums, Reading(error, "at"), 0.1) for error in ERRORS]
    assert at == pytest.approx([5.0, 5.0, 7 / 3, 7 / 3])
    up_to = [value_mm(sums, Reading(error, "up_to_30_hz"), 0.1) for error in ERRORS]
    by_axis = (sqrt(10 / 3), sqrt(20 / 3), 0.0)
    assert up_to == pytest.approx([sqrt(30 / 3), (1 + 2 + 5) / 3, sum(by_axis) / 3, (4 / 3 + 6 / 3) / 3])
    assert [value_mm(sums, Reading(error, "up_to_10_hz"), 0.1) for error in ERRORS] == pytest.approx(at)


def test_every_reading_is_a_row_once() -> None:
    assert len(READINGS) == len(set(READINGS)) == len(ERRORS) * len(SPANS)


_ERRORS = st.lists(st.tuples(*[st.floats(-0.1, 0.1)] * 3), min_size=1, max_size=4)


@given(_ERRORS, st.sampled_from(SPANS), st.sampled_from(HORIZONS_S))
def test_an_axis_is_below_space_and_a_mean_below_a_root(
    found: list[tuple[float, float, float]], span: str, horizon_s: float
) -> None:
    growth = np.sqrt(np.arange(1, N_AHEAD + 1))[None, :, None]
    sums = ErrorSums.of(np.array(found)[:, None, :] * growth)
    of = {each.error: value_mm(sums, each, horizon_s) for each in READINGS if each.span == span}
    assert of["mae_axis"] <= of["rmse_axis"] + 1e-9
    assert of["rmse_axis"] <= of["rmse_3d"] + 1e-9
    assert of["mean_distance"] <= of["rmse_3d"] + 1e-9


@given(_ERRORS, st.sampled_from(ERRORS), st.sampled_from(HORIZONS_S))
def test_up_to_a_horizon_is_below_at_it_where_errors_grow(
    found: list[tuple[float, float, float]], error: str, horizon_s: float
) -> None:
    sums = ErrorSums.of(np.array(found)[:, None, :] * np.linspace(0.1, 1, N_AHEAD)[None, :, None])
    of = {each.span: value_mm(sums, each, horizon_s) for each in READINGS if each.error == error}
    assert of["up_to_30_hz"] <= of["up_to_10_hz"] + 1e-9
    assert of["up_to_10_hz"] <= of["at"] + 1e-9
