"""The paper's simulation: its draws and its scores."""

from dataclasses import replace

import numpy as np

from tests.nodes import a_recording
from tests.patient_side.arm_models import static_model
from tis.deploy.studies.paper.cells import ROWS, simulate

HAND = a_recording(600).hands[0]


def test_in_milliseconds_the_first_five_rows_draw_no_delay_at_30_hz() -> None:
    for row in ROWS[:5]:
        assert simulate(row, "ms", static_model(), HAND, 30, 7, False).mean_delay_samples == 0


def test_as_samples_the_mean_delay_is_the_rows_own() -> None:
    for row, mean in zip(ROWS[2:5], (1.0, 5.0, 1.0), strict=True):
        drawn = simulate(row, "samples", static_model(), HAND, 30, 7, False).mean_delay_samples
        assert abs(drawn - mean) < 5 * row.jitter_ms / np.sqrt(len(HAND.command)) + 0.05


def test_a_model_without_states_stays_at_the_operating_point() -> None:
    model = static_model()
    found = simulate(ROWS[0], "ms", model, HAND, 30, 7, False)
    error = model.output_offset_m - HAND.follower.position_m
    assert np.allclose(found.score["rmse_mm"], 1e3 * np.sqrt(np.mean(error**2, axis=0)))


def test_the_same_seed_gives_the_same_draws_and_another_row_its_own() -> None:
    one, two = (simulate(ROWS[5], "ms", static_model(), HAND, 30, 7, False) for _ in range(2))
    assert one == two
    other = simulate(replace(ROWS[5], number=9), "ms", static_model(), HAND, 30, 7, False)
    assert other.mean_delay_samples != one.mean_delay_samples
