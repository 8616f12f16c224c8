import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.sources.table.row_clock import RowClock, played, resampled, row_clock
from tis.common.sources.trajectory import PoseTrack


def clock_of(t_s: list[float] | np.ndarray[tuple[int], np.dtype[np.float64]]) -> RowClock:
    clock, faults = row_clock(np.asarray(t_s, dtype=float), "t.csv", "t")
    assert faults == []
    assert clock is not None
    return clock


def test_rows_on_the_scenarios_grid_are_played_as_they_are() -> None:
    clock = clock_of(100.0 + np.arange(90) / 30)
    play, faults = played(clock, 30, resample=True, gaps="refuse", where="t.csv")
    assert (play.at_s, play.warnings, faults) == (None, (), [])
    assert clock.found_hz == pytest.approx(30.0)


def test_times_must_increase() -> None:
    clock, faults = row_clock(np.array([0.0, 1.0, 1.0, 2.0, 1.5]), "t.csv", "t")
    assert clock is None
    assert [str(fault) for fault in faults] == [
        "t.csv: row 2: must be later than the row before (column t): sort the rows, or leave repeated ones out "
        "(got '1 s after 1 s')",
        "t.csv: row 4: must be later than the row before (column t): sort the rows, or leave repeated ones out "
        "(got '1.5 s after 2 s')",
    ]


def test_another_rate_is_refused_with_what_to_set() -> None:
    _, faults = played(clock_of(np.arange(100) / 50), 30, resample=False, gaps="refuse", where="t.csv")
    assert [str(fault) for fault in faults] == [
        "t.csv: has 50 rows a second and the scenario's rate_hz is 30: set rate_hz: 50, or source.resample: true to "
        "interpolate rows at 30 Hz"
    ]
    _, faults = played(clock_of(np.arange(100) / 51.33), 30, resample=False, gaps="refuse", where="t.csv")
    assert "set source.resample: true to interpolate" in str(faults[0])


def test_gaps_are_refused_or_told() -> None:
    t_s = np.delete(np.arange(100) / 30, [40, 41, 42, 70])
    clock = clock_of(t_s)
    assert clock.gaps == (39, 66)
    words = "2 gaps, after 1.300 s (row 39; 133 ms), 2.300 s (row 66; 67 ms)"
    _, faults = played(clock, 30, resample=False, gaps="refuse", where="t.csv")
    assert [str(f) for f in faults] == [
        f"t.csv: has {words}: set source.gaps: bridge to play over them, or cut the table"
    ]
    play, faults = played(clock, 30, resample=False, gaps="bridge", where="t.csv")
    assert (play.at_s, faults) == (None, [])
    assert play.warnings == (f"{words}: played without the time that is missing",)
    play, faults = played(clock, 30, resample=True, gaps="bridge", where="t.csv")
    assert faults == []
    assert play.at_s is not None
    assert play.at_s == pytest.approx(np.arange(100) / 30)
    assert play.warnings[0] == f"{words}: interpolated"
    assert play.warnings[1].startswith("resampled from 30 rows a second to 30")


def test_a_slow_drift_of_the_rate_is_told() -> None:
    play, faults = played(clock_of(np.arange(3000) / 29.97), 30, resample=False, gaps="refuse", where="t.csv")
    assert faults == []
    assert play.warnings == (
        "its times depart from 30 rows a second by up to 100 ms; rows are played evenly (source.resample: true "
        "interpolates them)",
    )


def test_resampling_keeps_lines_straight_and_rotations_even() -> None:
    t_s = np.array([0.0, 0.02, 0.05, 0.06, 0.1])
    half = 1.5 * t_s / 2  # a turn about z at 1.5 rad/s
    turns = np.stack([0 * half, 0 * half, np.sin(half), np.cos(half)], axis=1)
    track = PoseTrack(np.outer(t_s, [1.0, -2.0, 0.5]), turns, 3.0 * t_s)
    at_s = np.array([0.0, 0.01, 0.055, 0.1])
    found = resampled(track, t_s, at_s)
    assert found.position_m == pytest.approx(np.outer(at_s, [1.0, -2.0, 0.5]))
    assert found.gripper_rad == pytest.approx(3.0 * at_s)
    assert found.orientation[:, 2] == pytest.approx(np.sin(0.75 * at_s))


@given(st.integers(20, 2000), st.integers(10, 500))
def test_resampled_rows_lie_within_the_recording(table_hz: int, rate_hz: int) -> None:
    clock = clock_of(np.arange(3 * table_hz) / table_hz)
    play, faults = played(clock, rate_hz, resample=True, gaps="refuse", where="t.csv")
    assert faults == []
    if play.at_s is not None:
        assert play.at_s[-1] <= clock.t_s[-1] < play.at_s[-1] + 1.001 / rate_hz
