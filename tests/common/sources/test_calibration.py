from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tis.common.sources.calibration import (
    RECORDED_SUTURING,
    RECORDED_TURNING,
    median_statistics,
    movement_statistics,
    turning_statistics,
)
from tis.common.sources.jigsaws import parse_trial, pose_track, position_m


def test_the_statistics_of_a_circle_are_known() -> None:
    radius_mm, turns_hz, n = 20.0, 0.75, 3000
    angle = 2 * np.pi * turns_hz * np.arange(n) / 30
    circle_m = radius_mm / 1000 * np.column_stack([np.cos(angle), np.sin(angle), np.zeros(n)])
    found = movement_statistics(np.array([1.0, -2.0, 3.0]) + circle_m, 30)
    assert found.keys() == RECORDED_SUTURING.keys()
    for hold_ms, lag in ((33, 1), (100, 3), (200, 6), (500, 15), (1000, 30)):
        chord_mm = 2 * radius_mm * abs(np.sin(np.pi * turns_hz * lag / 30))
        assert found[f"hold-last error at {hold_ms} ms, mm"] == pytest.approx(chord_mm, rel=1e-9)
    speed = 2 * np.pi * turns_hz * radius_mm
    for name in ("p50", "p90", "p99", "rms"):
        assert found[f"speed {name}, mm/s"] == pytest.approx(speed, rel=0.01)
        if name != "rms":
            assert found[f"acceleration {name}, mm/s2"] == pytest.approx(speed**2 / radius_mm, rel=0.02)
    assert found["time slower than 2 mm/s, share"] == 0.0
    assert found["velocity power up to 0.5 Hz, share"] < 0.01
    assert found["velocity power up to 1 Hz, share"] > 0.99


def test_the_statistics_of_a_precession_are_known() -> None:
    """An axis of 1.2 rad that turns: the rotation between two instants follows from SciPy, the rate is constant."""
    turns_hz, n = 0.75, 3000
    angle = 2 * np.pi * turns_hz * np.arange(n) / 30
    spin, tilt = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0]), Rotation.from_rotvec([1.2, 0.0, 0.0])
    found = turning_statistics((spin * tilt).as_quat(), 30)
    assert found.keys() == RECORDED_TURNING.keys()
    for hold_ms, lag in ((33, 1), (100, 3), (200, 6), (500, 15), (1000, 30)):
        away_deg = (360 * turns_hz * lag / 30 + 180) % 360 - 180
        assert found[f"hold-last error at {hold_ms} ms, deg"] == pytest.approx(abs(away_deg), rel=1e-6)
    for name in ("p50", "p90", "p99", "rms"):
        assert found[f"angular speed {name}, deg/s"] == pytest.approx(360 * turns_hz, rel=1e-6)
    # the tilt is on the body's side, so the axis stands still in the body's frame
    assert found["angular acceleration p99, deg/s2"] == pytest.approx(0.0, abs=1e-6)
    assert found["time slower than 5 deg/s, share"] == 0.0


def test_slow_time_is_counted_and_the_median_is_over_tips() -> None:
    half_m = np.concatenate([np.zeros(50), np.arange(50) * 1e-3])[:, np.newaxis] * [0.0, 0.0, 1.0]
    whole_m = np.arange(100)[:, np.newaxis] * [1e-3, 0.0, 0.0]
    found = median_statistics([half_m + 0.01 * whole_m * [0, 1, 0], whole_m, whole_m], 30)
    assert found["time slower than 2 mm/s, share"] == 0.0
    assert movement_statistics(half_m, 30)["time slower than 2 mm/s, share"] == pytest.approx(0.5, abs=0.02)
    assert found["speed p50, mm/s"] == pytest.approx(30.0)


def test_the_recorded_figures_are_understood(jigsaws_dir: Path) -> None:
    """A few recorded trials give, by our formulas, what was said of all of them."""
    files = sorted((jigsaws_dir / "Suturing" / "kinematics" / "AllGestures").glob("Suturing_[B-I]*.txt"))
    if len(files) < 4:
        pytest.skip(f"fewer than 4 suturing trials in {jigsaws_dir}")
    trials = [parse_trial(file.read_text(), file.name) for file in files]
    found = median_statistics([position_m(rows, arm) for rows in trials for arm in ("PSM1", "PSM2")], 30)
    ratios = {name: found[name] / recorded for name, recorded in RECORDED_SUTURING.items()}
    assert all(abs(ratio - 1) <= 0.25 for ratio in ratios.values()), ratios
    tips = [pose_track(rows, arm, "trial").orientation for rows in trials for arm in ("PSM1", "PSM2")]
    found = median_statistics(tips, 30, turning_statistics)
    ratios = {name: found[name] / recorded for name, recorded in RECORDED_TURNING.items()}
    assert all(abs(ratio - 1) <= 0.25 for ratio in ratios.values()), ratios
