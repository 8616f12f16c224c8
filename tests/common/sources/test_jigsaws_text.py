import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.common.sources.trials import FIRST
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.jigsaws import parse_trial, pose_track, position_m, trial_text
from tis.common.sources.pairing import pair_over
from tis.common.sources.synthetic import synthesise
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording

BOTH = SyntheticSource(kind="synthetic", hands=("left", "right"))
DEVICES = {"left": ("MTML", "PSM2"), "right": ("MTMR", "PSM1")}


@pytest.mark.parametrize("n_rows", [2, 600])
def test_what_is_written_is_read_again(n_rows: int) -> None:
    trial = synthesise(BOTH, 4, 30, n_rows, 0)
    text = trial_text(trial)
    rows = parse_trial(text, "S001")
    assert rows.shape == (n_rows, 76)
    assert text.endswith("\n")
    assert all(len(number.partition(".")[2]) == 8 for number in text.split())
    for hand in trial.hands:
        for device, track in zip(DEVICES[hand.hand], (hand.command, hand.follower), strict=True):
            read = pose_track(rows, device, "S001")
            assert np.abs(read.position_m - track.position_m).max() < 1e-6
            assert np.abs(np.abs(np.sum(read.orientation * track.orientation, axis=1)) - 1).max() < 1e-7
            assert np.abs(read.gripper_rad - track.gripper_rad).max() < 1e-6


def test_the_pairing_is_found_in_what_is_written() -> None:
    rows = parse_trial(trial_text(synthesise(BOTH, 8, 30, 1240, 0)), "S001")
    commands_m = {"left": position_m(rows, "MTML"), "right": position_m(rows, "MTMR")}
    arms_m = {"PSM1": position_m(rows, "PSM1"), "PSM2": position_m(rows, "PSM2")}
    left, right = pair_over("auto", ("left", "right"), [(commands_m, arms_m)])  # type: ignore[list-item]
    assert (left.arm, right.arm) == ("PSM2", "PSM1")
    assert left.warnings == right.warnings == ()
    for pairing in (left, right):
        ratios = sorted(fit.ratio for fit in pairing.fits)
        assert ratios[0] < 0.01
        assert ratios[1] > 0.5


def test_the_velocities_of_a_steady_screw_are_exact() -> None:
    t_s = np.arange(40) / 30
    axis_rad_per_s = np.array([0.3, -1.2, 0.5])
    velocity_m_per_s = np.array([0.01, 0.02, -0.03])
    start = Rotation.from_rotvec([0.4, 0.1, -0.7])
    turned = Rotation.from_rotvec(np.outer(t_s, axis_rad_per_s)) * start
    track = PoseTrack(np.outer(t_s, velocity_m_per_s), turned.as_quat(), 0.2 + 0.1 * t_s)
    hands = (HandRecording("left", "PSM2", track, track), HandRecording("right", "PSM1", track, track))
    rows = parse_trial(trial_text(Recording("screw", 30, hands, 0, "")), "screw")
    for first in FIRST.values():
        assert np.abs(rows[:, first + 12 : first + 15] - velocity_m_per_s).max() < 1e-6
        assert np.abs(rows[:, first + 15 : first + 18] - axis_rad_per_s).max() < 1e-6


def test_another_rate_or_one_hand_is_no_jigsaws_trial() -> None:
    with pytest.raises(ValueError, match="both hands at 30 Hz"):
        trial_text(synthesise(BOTH, 1, 31, 10, 0))
    with pytest.raises(ValueError, match="both hands at 30 Hz"):
        trial_text(synthesise(SyntheticSource(kind="synthetic"), 1, 30, 10, 0))
