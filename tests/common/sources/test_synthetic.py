from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.pairing import fit_arm
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Array, HandRecording, Recording

PLAIN = SyntheticSource(kind="synthetic", hands=("left", "right"), recorder_hz=51.33)
STEADY = SyntheticSource(kind="synthetic", tremor_mm=0.0, recorder_hz=51.33)
BARE = STEADY.model_copy(update={"drift_mm": 0.0, "coupling": 0.0, "recorder_hz": None})
CLUTCHED = PLAIN.model_copy(update={"clutch_per_min": 12.0})
LAGGING = CLUTCHED.model_copy(update={"arm_bandwidth_hz": 2.0})


def columns(hand: HandRecording) -> Array:
    """Return all that a hand holds, (N, 16)."""
    return np.column_stack(
        [
            part
            for track in (hand.command, hand.follower)
            for part in (track.position_m, track.orientation, track.gripper_rad)
        ]
    )


def everything(recording: Recording) -> Array:
    return np.column_stack([columns(hand) for hand in recording.hands])


def test_a_recording_says_what_it_is() -> None:
    recording = synthesise(PLAIN, seed=5, rate_hz=30, n_rows=100, start=40)
    assert recording.label == "synthetic surgeon, seed 5"
    assert (recording.rate_hz, recording.start, len(recording)) == (30, 40, 100)
    assert [(hand.hand, hand.arm) for hand in recording.hands] == [("left", "PSM2"), ("right", "PSM1")]
    assert "MTML -> PSM2 (synthetic" in recording.pairing
    assert recording.warnings == ()
    assert everything(recording).shape == (100, 32)


def test_the_seed_decides_everything() -> None:
    one, again, other = (synthesise(PLAIN, seed, 30, 300, 0) for seed in (3, 3, 4))
    assert np.array_equal(everything(one), everything(again))
    for mine, others in zip(one.hands, other.hands, strict=True):
        assert np.abs(mine.command.position_m[100:] - others.command.position_m[100:]).max() > 1e-3
        assert np.abs(mine.command.orientation[100:] - others.command.orientation[100:]).max() > 1e-3
        assert not np.array_equal(mine.command.gripper_rad, others.command.gripper_rad)


@settings(max_examples=20, deadline=None)
@given(
    seed=st.integers(0, 2**32),
    rate_hz=st.sampled_from([1, 30, 250]),
    short=st.integers(1, 400),
    more=st.integers(1, 5000),
    source=st.sampled_from([PLAIN, CLUTCHED]),
)
def test_a_longer_run_begins_alike(seed: int, rate_hz: int, short: int, more: int, source: SyntheticSource) -> None:
    short_run = everything(synthesise(source, seed, rate_hz, short, 0))
    long_run = everything(synthesise(source, seed, rate_hz, short + more, 0))
    assert np.array_equal(short_run, long_run[:short])


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32), rate_hz=st.sampled_from([30, 250]), short=st.integers(1, 400))
def test_so_does_one_whose_arm_lags(seed: int, rate_hz: int, short: int) -> None:
    short_run = everything(synthesise(LAGGING, seed, rate_hz, short, 0))
    long_run = everything(synthesise(LAGGING, seed, rate_hz, short + 700, 0))
    assert np.array_equal(short_run, long_run[:short])


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 1000), source=st.sampled_from([PLAIN, BARE, CLUTCHED]))
def test_another_rate_samples_the_same_path(seed: int, source: SyntheticSource) -> None:
    slow = everything(synthesise(source, seed, 30, 301, 0))
    fast = everything(synthesise(source, seed, 990, 9901, 0))
    assert np.abs(slow - fast[::33]).max() < 1e-12


def test_a_hand_is_the_same_with_and_without_the_other() -> None:
    both = synthesise(PLAIN, 9, 30, 200, 0)
    [alone] = synthesise(PLAIN.model_copy(update={"hands": ("right",)}), 9, 30, 200, 0).hands
    assert np.array_equal(columns(both.hands[1]), columns(alone))
    moved_m = [hand.command.position_m - hand.command.position_m[0] for hand in both.hands]
    assert np.abs(moved_m[0] - moved_m[1]).max() > 1e-3


def begins_with_one_bell(position_m: Array) -> bool:
    """Tell whether the first movement, up to its first rest, is straight with speed 30 p^2 (1 - p)^2."""
    path_m = position_m - position_m[0]
    speed = np.linalg.norm(np.diff(path_m, axis=0), axis=1)
    end = int(np.argmax(speed[10:] < 1e-12)) + 10
    length_m = float(np.linalg.norm(path_m[end]))
    done = np.linalg.norm(path_m[: end + 1], axis=1) / length_m
    p = (np.arange(end) + 0.5) / end
    bell = 30 * p**2 * (1 - p) ** 2 * length_m / end
    straight = np.abs(path_m[: end + 1] - np.outer(done, path_m[end])).max() < 1e-9 * length_m
    return bool(straight and np.abs(speed[:end] - bell).max() < 0.03 * bell.max())


def test_movements_that_nothing_overlaps_are_minimum_jerk() -> None:
    # four in five movements end in a pause, here of 5 s on average
    source = BARE.model_copy(update={"pause_s": 5.0})
    runs = (synthesise(source, seed, 1000, 6000, 0) for seed in range(30))
    n_bells = sum(begins_with_one_bell(run.hands[0].command.position_m) for run in runs)
    assert 17 <= n_bells <= 29


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_arm_is_half_the_master_with_a_residual_of_15_um(seed: int) -> None:
    for hand in synthesise(PLAIN, seed, 30, 3000, 0).hands:
        residual_m = hand.follower.position_m - 0.5 * hand.command.position_m
        centred_m = residual_m - residual_m.mean(axis=0)
        assert np.sqrt(np.mean(centred_m**2)) == pytest.approx(15e-6, rel=0.1)
        # smooth: neighbours differ by less than white noise of that size would (a factor of sqrt 2)
        assert np.sqrt(np.mean(np.diff(centred_m, axis=0) ** 2)) < 1.1 * 15e-6
        assert fit_arm(hand.command.position_m, hand.follower.position_m, hand.arm).ratio < 0.005
        assert np.array_equal(hand.follower.orientation, hand.command.orientation)
        assert np.array_equal(hand.follower.gripper_rad, hand.command.gripper_rad)


@pytest.mark.parametrize(("tremor_mm", "tremor_hz"), [(0.5, 9.0), (2.0, 6.0)])
def test_tremor_has_its_size_and_its_frequency(tremor_mm: float, tremor_hz: float) -> None:
    shaking = BARE.model_copy(update={"tremor_mm": tremor_mm, "tremor_hz": tremor_hz})
    n = 12_000
    calm_m = synthesise(BARE, 7, 100, n, 0).hands[0].command.position_m
    tremor_m = synthesise(shaking, 7, 100, n, 0).hands[0].command.position_m - calm_m
    assert tremor_m.std(axis=0) == pytest.approx(tremor_mm / 1000, rel=0.1)
    power = np.sum(np.abs(np.fft.rfft(tremor_m * np.hanning(n)[:, np.newaxis], axis=0)) ** 2, axis=1)
    hz = np.fft.rfftfreq(n, 0.01)
    assert power[np.abs(hz - tremor_hz) < 0.1 * tremor_hz].sum() > 0.99 * power.sum()
    assert np.abs(np.corrcoef(tremor_m.T) - np.eye(3)).max() < 0.5


@settings(max_examples=15, deadline=None)
@given(
    movement_s=st.floats(0.05, 60),
    pause_s=st.floats(0, 60),
    reach_mm=st.floats(0.1, 1000),
    tremor_mm=st.floats(0, 10),
    tremor_hz=st.floats(0.1, 14),
    drift_mm=st.floats(0, 100),
    coupling=st.floats(0, 1),
    clutch_per_min=st.floats(0, 30),
    recorder_hz=st.none() | st.floats(0.1, 1e6),
    seed=st.integers(0, 10_000),
)
def test_whatever_is_asked_for_is_finite_smooth_and_within_its_space(
    movement_s: float,
    pause_s: float,
    reach_mm: float,
    tremor_mm: float,
    tremor_hz: float,
    drift_mm: float,
    coupling: float,
    clutch_per_min: float,
    recorder_hz: float | None,
    seed: int,
) -> None:
    source = SyntheticSource(
        kind="synthetic",
        movement_s=movement_s,
        pause_s=pause_s,
        reach_mm=reach_mm,
        tremor_mm=tremor_mm,
        tremor_hz=tremor_hz,
        drift_mm=drift_mm,
        coupling=coupling,
        clutch_per_min=clutch_per_min,
        recorder_hz=recorder_hz,
    )
    [hand] = synthesise(source, seed, 30, 2000, 0).hands
    assert np.isfinite(columns(hand)).all()
    centre_m = np.array([0.1, -0.05, 0.35])
    # two sequences, whose overlapping movements pass a corner by no more than another side; ten sines reach
    # sqrt(20) deviations; the clutch takes the master 40 mm away
    reach_m = (6 * max(40.0, 1.5 * reach_mm) + 4.5 * (tremor_mm + drift_mm)) / 1000
    assert np.abs(hand.command.position_m - centre_m).max() <= reach_m + 0.04
    assert np.abs(hand.follower.position_m - hand.follower.position_m[0]).max() <= reach_m + 0.0002
    assert np.abs(np.linalg.norm(hand.command.orientation, axis=1) - 1).max() < 1e-12
    if recorder_hz is None or recorder_hz > 30:
        assert np.sum(hand.command.orientation[1:] * hand.command.orientation[:-1], axis=1).min() > 0.7
    assert hand.command.gripper_rad.min() >= -1e-12
    assert hand.command.gripper_rad.max() <= 0.8 + 1e-12


def test_the_gripper_opens_and_closes() -> None:
    gripper_rad = synthesise(BARE, 1, 30, 3000, 0).hands[0].command.gripper_rad
    turns = [b for a, b in pairwise(np.round(gripper_rad, 9)) if a != b and b in (0.0, 0.8)]
    # a switch of 0.5 s and a hold of 3 s on average: about 28 in 100 s
    assert 14 < len(turns) < 45
    assert all(a != b for a, b in pairwise(turns))


@pytest.mark.parametrize(("hold_s", "fewest", "most"), [(0.5, 80, 120), (9.5, 4, 20)])
def test_grippers_open_as_far_and_as_often_as_their_person_does(hold_s: float, fewest: int, most: int) -> None:
    source = BARE.model_copy(update={"gripper_open_rad": 1.4, "gripper_hold_s": hold_s})
    gripper_rad = synthesise(source, 1, 30, 3000, 0).hands[0].command.gripper_rad
    assert gripper_rad.max() == pytest.approx(1.4)
    assert fewest <= np.count_nonzero(np.diff(gripper_rad > 0.7)) <= most


def test_an_hour_later_everything_still_moves() -> None:
    [hand] = synthesise(STEADY, 1, 2, 7200, 0).hands
    last_minute = columns(hand)[-120:]
    assert np.ptp(last_minute, axis=0).min() > 1e-3


def test_movements_made_together_are_made_at_the_same_time() -> None:
    both = BARE.model_copy(update={"hands": ("left", "right")})
    for coupling, agreement in ((1.0, (0.999, 1.0)), (0.0, (0.4, 0.9))):
        source = both.model_copy(update={"coupling": coupling, "pause_s": 1.0})
        hands = synthesise(source, 3, 100, 20_000, 0).hands
        left, right = (np.linalg.norm(np.diff(hand.command.position_m, axis=0), axis=1) > 1e-6 for hand in hands)
        assert 0.2 < left.mean() < 0.8
        assert agreement[0] <= np.mean(left == right) <= agreement[1]
        moved_m = [hand.command.position_m - hand.command.position_m[0] for hand in hands]
        assert np.abs(moved_m[0] - moved_m[1]).max() > 0.01


@pytest.mark.parametrize("seed", [1, 2])
def test_a_recorder_shows_the_movement_in_steps_of_its_own(seed: int) -> None:
    rate_hz, n_s = 5133, 20  # a hundred rows for each sample of the recorder
    recorded, smooth = (
        synthesise(STEADY.model_copy(update={"recorder_hz": hz}), seed, rate_hz, n_s * rate_hz, 0).hands[0]
        for hz in (51.33, None)
    )
    taken = np.flatnonzero(np.any(np.diff(recorded.command.position_m, axis=0) != 0, axis=1)) + 1
    assert len(taken) == pytest.approx(51.33 * n_s, abs=2)
    assert set(np.diff(taken).tolist()) <= {99, 100, 101}
    # what is shown from a row on was there within that row
    step_m = np.abs(np.diff(smooth.command.position_m, axis=0)).max()
    assert np.abs(recorded.command.position_m[taken] - smooth.command.position_m[taken]).max() <= 1.01 * step_m
    arm_m = recorded.follower.position_m
    assert np.array_equal(np.flatnonzero(np.any(np.diff(arm_m, axis=0) != 0, axis=1)) + 1, taken)


def test_rows_faster_than_the_recorder_are_warned_of() -> None:
    [warning] = synthesise(PLAIN, 1, 1000, 2, 0).warnings
    assert "51.33 Hz" in warning
    assert "source.recorder_hz: null" in warning
    assert synthesise(BARE, 1, 1000, 2, 0).warnings == ()


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_while_the_clutch_is_pressed_the_arm_holds_and_the_offset_changes(seed: int) -> None:
    source = CLUTCHED.model_copy(update={"recorder_hz": None})
    left, right = synthesise(source, seed, 100, 12_000, 0).hands
    offset_mm = [1000 * (hand.follower.position_m - 0.5 * hand.command.position_m) for hand in (left, right)]
    # the residual of 15 um changes by some um in 10 ms, a master moved back by far more
    moved = [np.linalg.norm(np.diff(mm, axis=0), axis=1) > 0.03 for mm in offset_mm]
    assert 0.1 < moved[0].mean() < 0.25  # 12 times a minute for a little less than a second
    assert np.mean(moved[0] == moved[1]) > 0.97  # one pedal for both hands
    for hand, mm, away in zip((left, right), offset_mm, moved, strict=True):
        arm_step_mm = 1000 * np.linalg.norm(np.diff(hand.follower.position_m, axis=0), axis=1)
        assert arm_step_mm[away].max() < 0.02 < np.percentile(arm_step_mm[~away], 90)
        held = np.split(mm[1:][~away], np.flatnonzero(np.diff(np.flatnonzero(~away)) > 20) + 1)
        places = np.array([part.mean(axis=0) for part in held])
        assert len(held) > 10
        assert np.mean([part.std(axis=0) for part in held]) < 0.1
        assert np.linalg.norm(np.diff(places, axis=0), axis=1).min() > 1.0


def test_a_lagging_arm_makes_the_same_movement_later() -> None:
    """At low frequencies a servo of second order is late by ``2 zeta / w``; the command is as without it."""
    still = PLAIN.model_copy(update={"hands": ("left",), "tremor_mm": 0.0, "recorder_hz": None})
    lagging = still.model_copy(update={"arm_bandwidth_hz": 3.0, "arm_damping": 0.9})
    (at_once,), (late,) = (synthesise(each, 4, 250, 5000, 0).hands for each in (still, lagging))
    assert np.array_equal(at_once.command.position_m, late.command.position_m)
    shifted = round(2 * 0.9 / (2 * np.pi * 3.0) * 250)
    apart_m = late.follower.position_m - at_once.follower.position_m
    shifted_m = late.follower.position_m[shifted:] - at_once.follower.position_m[:-shifted]
    assert np.all(np.std(apart_m, axis=0) > 5e-4)
    assert np.all(np.std(shifted_m, axis=0) < 0.2 * np.std(apart_m, axis=0))
