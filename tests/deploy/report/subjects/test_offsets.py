import json

import numpy as np
import pytest

from tis.deploy.report.subjects.tracking import MAX_ALIGNED, Array, HandTrack, actuation_ms, offsets


def movement(t_s: Array) -> Array:
    return 0.05 * np.column_stack([np.sin(2 * t_s), np.cos(3 * t_s), np.sin(t_s + 1)])


def a_track(n: int = 300, **late_s: float) -> HandTrack:
    """Estimators that show the movement late by what their names say."""
    t_s = np.arange(n) / 30
    estimates = {name: movement(t_s - late) for name, late in late_s.items()}
    t_ns = np.round(t_s * 1e9).astype(np.int64)
    return HandTrack(t_ns, np.arange(n), movement(t_s), estimates, np.ones(n, dtype=np.bool_), {})


def test_a_late_estimator_is_late_and_right() -> None:
    found = offsets([a_track(hold=0.1)], "hold", 30)
    json.dumps(found.as_json(), allow_nan=False)
    assert found["time_ms"]["p50"] == pytest.approx(100)
    assert found["value_mm"]["p50"] < 0.1
    assert found["n"] == 300
    assert found["delay_derivative_ms_per_s"] < 50  # where the movement begins and ends nothing is known


def test_an_arm_is_as_late_as_it_follows_the_active_estimate() -> None:
    track = a_track(hold=0.1, kalman=0.0, plant=0.05)
    assert np.median(actuation_ms(track, "kalman", 30)) == pytest.approx(50)
    assert np.median(actuation_ms(track, "hold", 30)) == pytest.approx(-50)
    assert len(actuation_ms(a_track(hold=0.1), "hold", 30)) == 0


def test_long_runs_are_aligned_in_part_and_missing_estimates_are_left_out() -> None:
    assert offsets([a_track(MAX_ALIGNED + 50, hold=0.0)], "hold", 30)["n"] == MAX_ALIGNED
    track = a_track(60, hold=0.0)
    track.estimates["hold"][:20] = np.nan
    assert offsets([track], "hold", 30)["n"] == 40
    track.estimates["hold"][:] = np.nan
    empty = offsets([track], "hold", 30)
    assert (empty["n"], empty["value_rms_mm"], empty["delay_derivative_ms_per_s"]) == (0, None, None)
