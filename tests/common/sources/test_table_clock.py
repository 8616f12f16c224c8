import re
from typing import Any

import numpy as np
import pytest

from tis.common.scenario.table_source import MAX_RESAMPLED
from tis.common.sources.table_clock import SECONDS_PER, RowClock, played, row_clock, smoother_at


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


@pytest.mark.parametrize(("taken_for", "true_unit"), [("s", "ms"), ("us", "ns"), ("ms", "us"), ("ns", "us")])
def test_times_in_another_unit_are_refused_and_the_likely_one_named(taken_for: str, true_unit: str) -> None:
    t_s = np.arange(2000) / 50 / SECONDS_PER[true_unit] * SECONDS_PER[taken_for]
    for resample in (False, True):
        _, [fault] = played(clock_of(t_s), 50, resample, "refuse", "t.csv", taken_for)
        assert f"are its times in {true_unit} (50 rows a second over 39.98 s" in str(fault)
        assert f"source.units.time: {true_unit}" in str(fault)


@pytest.mark.parametrize("true_unit", ["ms", "us", "ns"])
def test_only_a_resampling_that_is_taken_is_offered(true_unit: str) -> None:
    t_s = np.arange(7200) / 120 / SECONDS_PER[true_unit]
    _, [fault] = played(clock_of(t_s), 120, False, "refuse", "t.csv", "s")
    assert f"source.units.time: {true_unit}" in str(fault)
    for offered in re.findall(r"source\.resample: (\d+)", str(fault)):
        assert not played(clock_of(t_s), 120, float(offered), "refuse", "t.csv", "s")[1]
        assert float(offered) <= MAX_RESAMPLED


@pytest.mark.parametrize(("found_hz", "resample", "is_played"), [
    (1000, True, True), (8, True, True), (7, True, False), (7, 5, True), (7, 4, False),
    (2, True, False), (2, 15, True),
])  # fmt: skip
def test_a_rate_is_raised_four_times_at_most_or_as_asked(found_hz: float, resample: Any, is_played: bool) -> None:
    play, faults = played(clock_of(np.arange(100) / found_hz), 30, resample, "refuse", "t.csv", "s")
    assert (play.at_s is not None, faults == []) == (is_played, is_played)


def test_gaps_are_refused_or_told() -> None:
    t_s = np.delete(np.arange(100) / 30, [40, 41, 42, 70])
    clock = clock_of(t_s)
    assert clock.gaps == (39, 66)
    words = "2 gaps, after 1.300 s (row 39; 133 ms), 2.300 s (row 66; 67 ms)"
    _, faults = played(clock, 30, resample=False, gaps="refuse", where="t.csv")
    assert [str(f) for f in faults] == [
        f"t.csv: has {words}: cut the table at them into files of one folder, and compare on these: tis compare "
        "--trials me_1.csv,me_2.csv; or set source.gaps: bridge to play over them"
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


def _swing(t_s: np.ndarray[Any, Any], noise_m: float = 0.0) -> np.ndarray[Any, Any]:
    clean = np.stack([0.05 * np.sin(2 * np.pi * hz * t_s + hz) for hz in (0.3, 0.7, 1.1)], axis=1)
    return np.asarray(clean + noise_m * np.random.default_rng(2).standard_normal(clean.shape))


@pytest.mark.parametrize("rate_hz", [50, 125])
@pytest.mark.parametrize("share", [0.1, 0.4])
def test_uneven_times_are_the_rows_own_where_paths_are_smoother_at_them(rate_hz: int, share: float) -> None:
    """A recorder may stamp rows as they were taken, or jitter when it stamps even ones, or round the times."""
    even_s = np.arange(20 * rate_hz) / rate_hz
    jitter = np.random.default_rng(1).uniform(-share, share, len(even_s)) / rate_hz
    own_s = even_s + jitter - jitter[0]
    rounded_s = np.round(even_s, 3)
    for noise_m in (0.0, 2e-5):
        assert smoother_at(own_s, [_swing(own_s, noise_m)])
        assert not smoother_at(own_s, [_swing(even_s, noise_m)])
        assert not smoother_at(rounded_s, [_swing(even_s, noise_m)])
    # where noise hides it, neither is smoother, and neither matters
    assert not smoother_at(own_s, [_swing(own_s, 0.02)])
    assert not smoother_at(own_s, [np.zeros((len(own_s), 3))])
    assert not smoother_at(own_s[:10], [_swing(own_s[:10])])


def test_rows_at_their_own_uneven_times_are_interpolated_and_others_are_not() -> None:
    jitter = np.random.default_rng(1).uniform(-0.004, 0.004, 1000)
    clock = clock_of(np.arange(1000) / 50 + jitter - jitter[0])
    found, faults = played(clock, 50, "auto", "refuse", "x", smoother=True)
    assert not faults
    assert found.at_s is not None
    np.testing.assert_allclose(np.diff(found.at_s[:-1]), 0.02)
    [told] = found.warnings
    assert told.startswith("its times depart from 50 rows a second by up to ")
    assert "rows are interpolated" in told
    # false is as the user asks, and a rougher path has the jitter of whoever stamped it
    for resample, smoother in ((False, True), ("auto", False)):
        found, faults = played(clock, 50, resample, "refuse", "x", smoother=smoother)  # type: ignore[arg-type]
        assert (found.at_s, found.warnings, faults) == (None, (), [])
    # another rate stays refused
    _, [fault] = played(clock, 30, "auto", "refuse", "x", smoother=True)
    assert "source.resample: true" in fault.rule
