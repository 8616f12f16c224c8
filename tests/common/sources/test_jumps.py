from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.channels import MASTER
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.jigsaws import RATE_HZ, parse_trial, position_m
from tis.common.sources.jumps import jumps, stretches
from tis.common.sources.plausibility import anomalies
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import Array, HandRecording, PoseTrack, Recording

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
    assert text == "PSM1 jumps as no hand moves it, from row 456 to 457 (14 mm): are rows missing?"


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
