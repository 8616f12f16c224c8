import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import DataError
from tis.deploy.recordings_import.found import Found, Ints, Jaw, Stream
from tis.deploy.recordings_import.one_clock import on_one_clock

MS = 1_000_000


def stream(device: str, t_ns: Ints) -> Stream:
    """Return a movement of 3 m/s along x, 1 rad/s about z, from run time 0."""
    t_s = t_ns / 1e9
    position = np.stack([3.0 * t_s, 0 * t_s, 0 * t_s], axis=1)
    turn = np.stack([0 * t_s, 0 * t_s, np.sin(t_s / 2), np.cos(t_s / 2)], axis=1)
    return Stream(device, f"/{device}", t_ns, position, turn, None)


def every(period_ms: int, n: int, phase_ms: int = 0) -> Ints:
    return (phase_ms + period_ms * np.arange(n, dtype=np.int64)) * MS


def test_streams_of_one_clock_keep_their_rows() -> None:
    rows = on_one_clock(Found((stream("PSM2", every(20, 50)), stream("MTML", every(20, 50)))), None, "f")
    assert rows.rate_hz == 50
    assert np.array_equal(rows.t_s, np.arange(50) / 50)
    assert [device.name for device in rows.devices] == ["MTML", "PSM2"]
    assert np.array_equal(rows.devices[0].track.position_m[:, 0], 3.0 * (every(20, 50) / 1e9))


def test_the_rate_that_is_told_is_that_of_the_poses_in_that_time_also_with_jitter() -> None:
    jittered = np.append(0, np.cumsum(np.tile([19, 19, 22], 300))).astype(np.int64) * MS
    [note, *_] = on_one_clock(Found((stream("MTML", jittered),)), None, "f").notes
    assert note == "/MTML: 901 poses in 18.000 s, 50 a second; no gap"
    [note, *_] = on_one_clock(Found((stream("MTML", np.delete(every(20, 50), [10, 11])),)), None, "f").notes
    assert note == "/MTML: 48 poses in 0.980 s, 50 a second outside of gaps"


def test_gaps_of_rows_that_are_kept_are_told() -> None:
    rows = on_one_clock(Found((stream("MTML", np.delete(every(20, 50), [10, 11])),)), None, "f")
    assert "/MTML: 1 gap, after 0.180 s (60 ms)" in rows.notes
    assert len(rows.t_s) == 48


def test_other_instants_are_interpolated_where_all_are_there() -> None:
    found = Found((stream("MTML", every(10, 100)), stream("PSM2", every(25, 30, phase_ms=7))))
    rows = on_one_clock(found, 50, "f")
    # from 7 ms, the second stream's first, to 732 ms, its last
    assert np.array_equal(rows.t_s, np.arange(37) / 50)
    for device in rows.devices:
        assert device.track.position_m[:, 0] == pytest.approx(3.0 * (0.007 + rows.t_s))
        assert device.track.orientation[:, 2] == pytest.approx(np.sin((0.007 + rows.t_s) / 2))
    assert rows.notes[-1] == "interpolated at 50 rows a second, 37 rows while all streams are there"


def test_the_first_masters_rate_is_the_default() -> None:
    found = Found((stream("PSM2", every(2, 500)), stream("MTML", every(10, 100))))
    assert on_one_clock(found, None, "f").rate_hz == 100


def test_rows_within_a_gap_are_left_out() -> None:
    gappy = np.delete(every(10, 100), range(40, 50))
    rows = on_one_clock(Found((stream("MTML", every(10, 100)), stream("PSM2", gappy))), 100, "f")
    assert np.round(100 * rows.t_s).astype(int).tolist() == [*range(40), *range(50, 100)]
    assert "/PSM2: 1 gap, after 0.390 s (110 ms)" in rows.notes
    assert rows.notes[-1] == "10 rows within gaps are left out: a run refuses the table, or bridges them"


def test_grippers_have_instants_of_their_own() -> None:
    angle = Jaw("MTML", "/jaw", every(40, 30), np.linspace(0.0, 2.9, 30))
    [device] = on_one_clock(Found((stream("MTML", every(20, 50)),), (angle,)), None, "f").devices
    assert device.grips
    assert device.track.gripper_rad == pytest.approx(0.1 * np.arange(50) / 2)


def test_streams_without_a_common_time_are_refused() -> None:
    found = Found((stream("MTML", every(10, 10)), stream("PSM2", every(10, 10, phase_ms=500))))
    with pytest.raises(DataError, match="no time in common"):
        on_one_clock(found, None, "f")


def test_too_many_rows_are_refused_before_they_are_made() -> None:
    with pytest.raises(DataError, match="at most 4000000 rows at 1e\\+06 a second"):
        on_one_clock(Found((stream("MTML", every(1000, 100)),)), 1e6, "f")


@given(st.integers(1, 60), st.integers(0, 200), st.integers(5, 400))
def test_every_row_lies_within_all_streams(period_ms: int, phase_ms: int, rate_hz: int) -> None:
    found = Found((stream("MTML", every(10, 100)), stream("PSM2", every(period_ms, 60, phase_ms))))
    first, last = max(0, phase_ms), min(990, phase_ms + 59 * period_ms)
    if last <= first:
        return
    try:
        rows = on_one_clock(found, rate_hz, "f")
    except DataError:
        assert (last - first) * rate_hz < 1000 + rate_hz
        return
    at_s = first / 1000 + rows.t_s
    assert at_s[-1] <= last / 1000 + 1e-9
    for device in rows.devices:
        assert device.track.position_m[:, 0] == pytest.approx(3.0 * at_s, abs=1e-6)
