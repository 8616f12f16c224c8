import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.channels import MASTER
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.jigsaws import RATE_HZ, parse_trial, position_m
from tis.common.sources.plausibility import FAR, anomalies, jumps, rate_doubts, stretches
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Array, HandRecording, PoseTrack, Recording

MISSING = "are rows missing? If so, cut it there"
DEVICES = (*MASTER.values(), "PSM1", "PSM2")


def wander(n_rows: int = 900, seed: int = 0) -> Array:
    """Return a movement (n_rows, 3) at 30 Hz of up to 4 mm a row, with the tremor of a hand."""
    rng = np.random.default_rng(seed)
    t_s = np.arange(n_rows)[:, np.newaxis, np.newaxis] / 30
    f_hz, phase = rng.uniform(0.05, 0.5, (2, 1, 8, 3))
    return np.asarray(
        np.sum(0.01 * np.sin(2 * np.pi * f_hz * t_s + 9 * phase), 1) + 5e-5 * rng.normal(size=(n_rows, 3))
    )


def recorded(command_m: Array, follower_m: Array) -> Recording:
    def track(position_m: Array) -> PoseTrack:
        return PoseTrack(position_m, np.tile([0.0, 0.0, 0.0, 1.0], (len(position_m), 1)), np.zeros(len(position_m)))

    return Recording("T", 30, (HandRecording("left", "PSM2", track(command_m), track(follower_m)),), 0, "")


def largest_step_mm(position_m: Array) -> float:
    return 1000 * float(np.linalg.norm(np.diff(position_m, axis=0), axis=1).max())


def test_a_jump_below_any_absolute_bound_is_found_by_the_movement_around_it() -> None:
    jumped = 0.4 * wander()
    assert largest_step_mm(jumped) < 2.5
    assert jumps(jumped, 30) == []
    jumped[457:] += 0.014 * np.array([1.0, 0.0, 0.0])
    assert jumps(jumped, 30) == [457]
    [text] = anomalies(jumped, 30, "PSM1", False)
    assert text == f"PSM1 jumps as no hand moves it, from row 456 to 457 (14 mm): {MISSING}"


def test_one_wrong_row_is_two_jumps_and_three_are_two_places() -> None:
    positions = wander()
    positions[300] += 0.06
    positions[600:603] += 0.06
    assert jumps(positions, 30) == [300, 301, 600, 603]


@settings(max_examples=60, deadline=None)
@given(
    n_rows=st.floats(3.0, 60.0),
    phase=st.floats(0.0, 1.0),
    size_m=st.floats(0.001, 0.3),
    before=st.sampled_from([0, 40, 400]),
)
def test_a_reach_of_three_rows_or_more_out_of_rest_is_no_jump(
    n_rows: float, phase: float, size_m: float, before: int
) -> None:
    tau = np.clip((np.arange(-before, 60 + before) - phase) / n_rows, 0.0, 1.0)
    along = 10 * tau**3 - 15 * tau**4 + 6 * tau**5
    tremor = 1e-5 * np.random.default_rng(1).normal(size=(len(along), 3))
    assert jumps(size_m * along[:, np.newaxis] * np.ones(3) / 3**0.5 + tremor, 30) == []


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), rate_hz=st.sampled_from([10, 30, 100, 500]), recorded_hz=st.booleans())
def test_the_synthetic_surgeon_never_jumps(seed: int, rate_hz: int, recorded_hz: bool) -> None:
    source = SyntheticSource(kind="synthetic", recorder_hz=51.33 if recorded_hz else None)
    movement = synthesise(source, seed, rate_hz, 30 * rate_hz, 0)
    assert stretches(movement) == [(0, len(movement))]


def test_a_white_or_a_constant_signal_and_wrong_units_have_none() -> None:
    rng = np.random.default_rng(2)
    assert jumps(rng.normal(size=(500, 3)), 30) == []
    assert jumps(np.zeros((500, 3)), 30) == []
    assert jumps(np.full((1, 3), 0.2), 30) == []
    millimetres = 1000 * wander()
    millimetres[400:] += 5000
    assert jumps(millimetres, 30) == []


def test_all_devices_are_cut_where_one_of_them_jumps() -> None:
    command, follower = wander(seed=1), wander(seed=2)
    assert stretches(recorded(command, follower)) == [(0, 900)]
    command[200:] += 0.05
    follower[700:] += 0.05
    assert stretches(recorded(command, follower)) == [(0, 200), (200, 700), (700, 900)]


def real_trials(jigsaws_dir: Path) -> list[Path]:
    return sorted(jigsaws_dir.glob("*/kinematics/AllGestures/*.txt"))


def test_of_the_recorded_trials_one_jumps_with_all_its_devices(jigsaws_dir: Path) -> None:
    found = {}
    for file in real_trials(jigsaws_dir):
        rows = parse_trial(file.read_text(), file.name)
        for device in DEVICES:
            at = jumps(position_m(rows, device), RATE_HZ)
            if at:
                found[file.stem, device] = at
    if not any(file.stem == "Suturing_D001" for file in real_trials(jigsaws_dir)):
        pytest.skip("Suturing_D001 is not among the trials here")
    assert found == {("Suturing_D001", device): [857] for device in DEVICES}


def swing(n_rows: int = 900, rate_hz: int = 30, size_m: float = 0.1) -> Array:
    """Return a slow movement (n_rows, 3): at its quickest 2 pi 0.1 / 4 s = 0.16 m/s and 0.25 m/s^2."""
    t_s = np.arange(n_rows) / rate_hz
    return size_m * np.stack([np.sin(np.pi * t_s / 2), np.cos(np.pi * t_s / 2), np.sin(np.pi * t_s / 3)], axis=1)


def test_a_slow_movement_raises_no_doubt() -> None:
    assert anomalies(swing(), 30, "MTML", True) == ()


def test_millimetres_are_asked_about_and_nothing_else_is() -> None:
    [text] = anomalies(1000 * swing(), 30, "PSM2", False)
    assert text == "PSM2 moves over 200 m, further than any arm: are these millimetres?"


def test_rows_that_were_cut_out_are_named() -> None:
    whole = swing()
    cut = np.delete(whole, slice(300, 361), axis=0)
    jumped_mm = 1000 * float(np.linalg.norm(whole[361] - whole[299]))
    assert jumped_mm > 100
    [text] = anomalies(cut, 30, "MTML", True)
    expected = f"MTML jumps as no hand moves it, from row 299 to 300 ({jumped_mm:.0f} mm): {MISSING}"
    assert text == expected
    # the same rows, of a recorder a hundred times slower, are no jump
    assert anomalies(cut, 0.3, "MTML", False) == ()


@pytest.mark.parametrize("n_rows", [1, 2, 3])
def test_a_spike_is_told_from_a_step_and_each_has_its_cure(n_rows: int) -> None:
    positions = swing()
    positions[300 : 300 + n_rows] += [0.4, -0.2, 0.1]
    found = anomalies(positions, 30, "MTML", True)
    assert all("leaves its path and is back within 4 rows, from row " in text for text in found)
    assert all("put what lies between their neighbours there" in text for text in found)
    assert len(found) == 1
    positions[600:] += 0.1
    step, spike = anomalies(positions, 30, "MTML", True)
    assert "jumps as no hand moves it, from row 599 to 600 (17" in step
    assert step.endswith(MISSING)
    assert spike == found[0]


def test_a_hand_in_ten_times_too_large_a_unit_is_asked_about() -> None:
    hand = wander()
    hand *= 0.14 / np.ptp(hand, axis=0).max()
    assert not any("a unit" in text or "the unit" in text for text in anomalies(hand, 30, "MTML", True))
    asked = anomalies(10 * hand, 30, "MTML", True, unit_named=True)
    assert asked[0] == "MTML moves over 1.4 m, and fast: does a hand, or is the unit ten times too large?"
    # a drone in a room takes seconds for as much, and so does a rover
    slow = 0.7 * np.sin(0.6 * np.arange(3000)[:, np.newaxis] / 30 + np.arange(3))
    assert not any("the unit" in text for text in anomalies(slow, 30, "MTML", True))


def test_a_far_movement_in_a_named_unit_is_in_doubt_only_where_no_vehicle_moves_so() -> None:
    flight = 3.8 * np.sin(0.8 * np.arange(3600)[:, np.newaxis] / 30 + np.arange(3))
    assert any(FAR in text for text in anomalies(flight, 30, "MTML", True))
    assert anomalies(flight, 30, "MTML", True, unit_named=True) == ()
    assert any(FAR in text for text in anomalies(1000 * wander(), 30, "MTML", True, unit_named=True))


def test_more_jumps_than_are_shown_are_counted() -> None:
    steps = swing()
    for row in range(100, 700, 100):
        steps[row:] += 0.05
    [text] = anomalies(steps, 30, "MTML", True)
    assert "from row 99 to 100 (" in text
    assert "299 to 300 (" in text
    assert text.endswith(") and 3 more times: are rows missing? If so, cut it there")


def test_noise_of_all_rows_is_no_jump_and_a_jump_within_it_is_named() -> None:
    noisy = swing(6000, 200) + 3e-4 * np.random.default_rng(1).normal(size=(6000, 3))
    [noise] = anomalies(noisy, 200, "MTML", True)
    assert noise.startswith("MTML has noise of 0.3 mm between rows")
    noisy[3000:] += 0.05
    again, jump = anomalies(noisy, 200, "MTML", True)
    assert again == noise
    assert "from row 2999 to 3000 (" in jump
    assert "more times" not in jump


def test_where_rows_are_repeated_the_path_jumps_at_their_end_alone() -> None:
    """A tracker that loses its markers tells the last pose again, and then the true one."""
    frozen = swing(3000, 100) * 4
    frozen[1000:1120] = frozen[1000]
    [text] = anomalies(frozen, 100, "MTML", True)
    assert "from row 1119 to 1120 (" in text
    assert "999" not in text


@pytest.mark.parametrize(("rate_hz", "noise_mm"), [(60, 1.0), (120, 0.2), (250, 0.05)])
def test_a_little_noise_is_no_jump_at_any_rate(rate_hz: int, noise_mm: float) -> None:
    noisy = swing(40 * rate_hz, rate_hz)
    noisy += noise_mm * 1e-3 * np.random.default_rng(1).normal(size=noisy.shape)
    assert anomalies(noisy, rate_hz, "MTML", True) == ()


def test_rows_that_are_often_missing_are_no_noise() -> None:
    kept = np.delete(swing(4000, 200), [row for k in range(100, 3900, 60) for row in range(k, k + 40)], axis=0)
    [text] = anomalies(kept, 200, "MTML", True)
    assert "jumps as no hand moves it" in text


def test_a_trajectory_may_begin_at_its_origin_rest_there_and_cross_it() -> None:
    moved = swing() - swing()[0]
    rested = np.concatenate([np.zeros((50, 3)), moved])
    crossing = np.column_stack([np.arange(-100, 100), np.arange(-100, 100), np.zeros(200)]) * 1e-3
    for each in (moved, rested, crossing):
        path_m = np.asarray(each, dtype=np.float64)
        assert (path_m == 0.0).all(axis=1).any()
        assert anomalies(path_m, 30, "PSM1", False) == ()


def test_zeros_are_named_and_so_are_the_jumps_to_them() -> None:
    filled = swing() + 0.5
    filled[400:460] = 0.0
    zeros, jumps = anomalies(filled, 30, "PSM1", False)
    assert zeros == "PSM1 is at exactly 0 0 0 in rows 400-459: were rows filled in?"
    assert "from row 399 to 400 (" in jumps
    assert "459 to 460 (" in jumps


@pytest.mark.parametrize(("n_repeats", "told"), [(59, False), (60, False), (61, True), (99, True)])
def test_a_master_that_repeats_a_row_for_longer_than_two_seconds_is_doubted(n_repeats: int, told: bool) -> None:
    held = np.concatenate([swing()[:200], np.repeat(swing()[199:200], n_repeats, axis=0), swing()[200:]])
    found = anomalies(held, 30, "MTMR", True)
    assert len(found) == told
    if told:
        span = f"rows 199-{199 + n_repeats}"
        assert found[0].startswith(
            f"MTMR repeats one position to the last digit for up to {n_repeats / 30:.1f} s, in {span}:"
        )
    assert anomalies(held, 30, "PSM2", False) == ()  # an arm stands still while a clutch is pressed


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 1000), rate_hz=st.sampled_from([30, 200]), recorded=st.booleans())
def test_the_synthetic_surgeon_raises_none(seed: int, rate_hz: int, recorded: bool) -> None:
    source = SyntheticSource(kind="synthetic", recorder_hz=51.33 if recorded and rate_hz == 30 else None)
    [hand] = synthesise(source, seed, rate_hz, 30 * rate_hz, 0).hands
    assert anomalies(hand.command.position_m, rate_hz, "MTML", True) == ()
    assert anomalies(hand.follower.position_m, rate_hz, "PSM2", False) == ()


@pytest.mark.parametrize("rate_hz", [20, 30, 50])
def test_velocities_of_about_the_rate_raise_no_doubt(rate_hz: int) -> None:
    positions = swing(rate_hz=rate_hz)
    velocities = np.gradient(positions, 1 / rate_hz, axis=0)
    assert rate_doubts(positions, np.roll(velocities, -2, axis=0), 30, "MTML") == ()


@pytest.mark.parametrize("rate_hz", [10, 200])
def test_velocities_tell_another_rate(rate_hz: int) -> None:
    positions = swing(rate_hz=rate_hz)
    [text] = rate_doubts(positions, np.gradient(positions, 1 / rate_hz, axis=0), 30, "MTML")
    found = re.search(r"taken for 30 rows per second; by its velocities it has ([\d.]+):", text)
    assert found is not None
    assert float(found[1]) == pytest.approx(rate_hz, rel=0.02)


def test_velocities_that_were_not_recorded_and_an_arm_that_stands_still_tell_nothing() -> None:
    still = np.zeros((90, 3))
    assert rate_doubts(swing(90), still, 30, "MTML") == rate_doubts(still, swing(90), 30, "MTML") == ()


@pytest.mark.parametrize("step_mm", [0.1, 1.0])
def test_positions_in_whole_steps_do_not_jump_and_missing_rows_still_do(step_mm: float) -> None:
    rounded = np.round(swing(6000, 200) * 1000 / step_mm) * step_mm / 1000
    assert anomalies(rounded, 200, "PSM2", False) == ()
    [text] = anomalies(np.delete(rounded, slice(2000, 2200), axis=0), 200, "PSM2", False)
    assert "from row 1999 to 2000 (" in text
