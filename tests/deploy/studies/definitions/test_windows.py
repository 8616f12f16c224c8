"""Errors of an axis over the ten steps of a window, against sums by hand."""

import numpy as np
import pytest

from tests.deploy.studies.definitions.test_velocity_inputs import a_recording
from tis.deploy.compare.cells.forecasts import ErrorSums
from tis.deploy.studies.definitions.readings import N_AHEAD
from tis.deploy.studies.definitions.velocity_inputs import LEAST_SQUARES, N_OUT, window_rows


def test_all_ten_steps_of_an_axis_count_and_none_after_them() -> None:
    errors_m = np.zeros((2, 60, 3))
    errors_m[0, :N_OUT, 0] = 0.003  # of 20 steps one half
    errors_m[1, N_OUT - 1, 1] = 0.004
    errors_m[:, N_OUT:] = 1.0
    sums = ErrorSums.of(errors_m).to_json()
    result = {"forecasts": {"left": {"hold": sums, "innovations_kf": sums}}}
    rows = window_rows([result], ())
    assert [(row["hand"], row["name"], row["n_windows"]) for row in rows] == [
        ("left", "hold", 2),
        ("left", "innovations_kf", 2),
    ]
    assert rows[0]["rmse_mm"] == pytest.approx([3 * np.sqrt(0.5), 4 / np.sqrt(20), 0.0])
    assert rows[0]["mae_mm"] == pytest.approx([1.5, 0.2, 0.0])


def test_least_squares_know_thirty_rows_of_the_other_people() -> None:
    found = []
    for number, label in enumerate(("Suturing_S001 (synthetic)", "Suturing_T002")):
        velocity = np.array([0.1, -0.2, 0.3]) * (1 + number)
        found.append(a_recording(label, np.arange(150)[:, None] / 30 * velocity, np.tile(velocity, (150, 1))))
    [row] = window_rows([], found)
    assert (row["hand"], row["name"]) == ("left", LEAST_SQUARES)
    assert row["n_windows"] == 2 * len(range(60, 150 - N_AHEAD, 3))
    assert max(*row["rmse_mm"], *row["mae_mm"]) < 1e-6
