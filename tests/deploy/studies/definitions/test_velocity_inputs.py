"""The least-squares forecast: exact where the past determines the movement, and better with a glance ahead."""

from dataclasses import replace
from math import sqrt

import numpy as np
import pytest

from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.deploy.compare.cells.forecasts import ErrorSums
from tis.deploy.studies.definitions.velocity_inputs import INPUTS, Inputs, leave_user_out
from tis.patient_side.linear_system import Array

N_AHEAD = 6


def a_recording(label: str, position_m: Array, velocity_m_s: Array) -> Recording:
    n = len(position_m)
    track = PoseTrack(position_m, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros(n))
    hand = HandRecording("left", "PSM2", track, track, velocity_m_s)
    return Recording(label=label, rate_hz=30, hands=(hand,), start=0, pairing="cross")


def _rmse(sums: ErrorSums | None, ahead: int) -> float:
    assert sums is not None
    return sqrt(sums.squares_m2[ahead - 1].sum() / sums.n)


@pytest.mark.parametrize("inputs", INPUTS)
def test_a_constant_velocity_is_forecast_without_an_error(inputs: Inputs) -> None:
    found = []
    for number, label in enumerate(("Suturing_S001 (synthetic)", "Suturing_T002")):
        velocity = np.array([0.1, -0.2, 0.3]) * (1 + number)
        position = np.arange(150)[:, None] / 30 * velocity
        found.append(a_recording(label, position, np.tile(velocity, (150, 1))))
    sums = leave_user_out(found, inputs, N_AHEAD)
    assert sums is not None
    assert sums.n == 2 * len(range(60, 150 - N_AHEAD, 3))
    assert _rmse(sums, N_AHEAD) < 1e-9


def test_a_velocity_that_looks_ahead_makes_the_forecast_better() -> None:
    """A random walk: its past tells nothing of the next step, a central difference a half of it."""
    generator = np.random.default_rng(1)
    found = []
    for label in ("Suturing_C001", "Suturing_D001"):
        position = np.cumsum(generator.normal(0, 0.001, (3000, 3)), axis=0)
        found.append(a_recording(label, position, np.gradient(position, 1 / 30, axis=0)))
    blind, ahead = (_rmse(leave_user_out(found, Inputs(30, velocity), 1), 1) for velocity in (False, True))
    assert blind == pytest.approx(0.001 * sqrt(3), rel=0.05)
    assert ahead < 0.1 * blind


def test_without_another_person_there_is_no_forecast() -> None:
    one = a_recording("Suturing_C001", np.zeros((150, 3)), np.zeros((150, 3)))
    assert leave_user_out([one, replace(one, label="Suturing_C002")], INPUTS[0], N_AHEAD) is None
