from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.channels import Arm, Hand
from tis.common.sources.jigsaws import parse_trial, position_m
from tis.common.sources.pairing import contradictions, fit_arm, pair_over
from tis.common.sources.trajectory import Array


def walk(seed: int, n_rows: int = 400) -> Array:
    steps_m = np.random.default_rng(seed).normal(scale=1e-3, size=(n_rows, 3))
    return np.asarray(np.cumsum(steps_m, axis=0))


def follower(command_m: Array, seed: int, noise_m: float = 1e-5) -> Array:
    noise = np.random.default_rng(seed).normal(scale=noise_m, size=command_m.shape)
    return np.asarray(0.5 * command_m + np.array([0.1, 0.2, -0.3]) + noise)


LEFT, RIGHT = walk(1), walk(2)
CROSSED: dict[Arm, Array] = {"PSM1": follower(RIGHT, 3), "PSM2": follower(LEFT, 4)}
NAMED: dict[Arm, Array] = {"PSM1": follower(LEFT, 4), "PSM2": follower(RIGHT, 3)}
COMMANDS: dict[Hand, Array] = {"left": LEFT, "right": RIGHT}


@pytest.mark.parametrize(("arms", "expected"), [(CROSSED, ("PSM2", "PSM1")), (NAMED, ("PSM1", "PSM2"))])
def test_auto_finds_the_arms_that_follow(arms: dict[Arm, Array], expected: tuple[str, str]) -> None:
    pairings = pair_over("auto", ("left", "right"), [(COMMANDS, arms)])
    assert tuple(pairing.arm for pairing in pairings) == expected
    assert [pairing.warnings for pairing in pairings] == [(), ()]
    [alone] = pair_over("auto", ("right",), [(COMMANDS, arms)])
    assert (alone.hand, alone.arm) == ("right", expected[1])


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 1000), noise_m=st.floats(1e-6, 1e-4))
def test_the_residual_is_the_noise_whatever_the_gain(seed: int, noise_m: float) -> None:
    rng = np.random.default_rng(seed)
    command_m = walk(seed)
    gain = rng.normal(size=(3, 3)) + 2 * np.eye(3)
    arm_m = command_m @ gain + rng.normal(size=3) + rng.normal(scale=noise_m, size=command_m.shape)
    fit = fit_arm(command_m, arm_m, "PSM1")
    # 4 of 400 degrees of freedom per axis go into the map: 0.995, and 1200 draws scatter by 2 %
    assert fit.residual_rms_m == pytest.approx(0.995 * 3**0.5 * noise_m, rel=0.12)
    assert fit.ratio == pytest.approx(fit.residual_rms_m / np.sqrt(arm_m.var(axis=0).sum()))


def test_the_residual_is_that_of_the_normal_equations() -> None:
    command_m, arm_m = LEFT, CROSSED["PSM1"]
    regressors = np.column_stack([command_m, np.ones(len(command_m))])
    theta = np.linalg.solve(regressors.T @ regressors, regressors.T @ arm_m)
    residual_m = np.sqrt(np.mean(np.sum((arm_m - regressors @ theta) ** 2, axis=1)))
    assert fit_arm(command_m, arm_m, "PSM1").residual_rms_m == pytest.approx(residual_m, rel=1e-9)


@pytest.mark.parametrize(("requested", "expected"), [("cross", "PSM2"), ("same_name", "PSM1")])
@pytest.mark.parametrize("arms", [CROSSED, NAMED])
def test_an_order_is_obeyed_with_a_warning_where_the_data_disagree(
    requested: str, expected: str, arms: dict[Arm, Array]
) -> None:
    [pairing] = pair_over("cross" if requested == "cross" else "same_name", ("left",), [(COMMANDS, arms)])
    assert pairing.arm == expected
    agrees = (arms is CROSSED) == (requested == "cross")
    assert len(pairing.warnings) == (0 if agrees else 1)
    if not agrees:
        [text] = pairing.warnings
        other = "PSM1" if expected == "PSM2" else "PSM2"
        assert text.startswith(f"{expected} is used for MTML as told (pairing: {requested}), but {other} follows it:")
        for fit in pairing.fits:
            assert f"{1000 * fit.residual_rms_m:.3f} mm rms of {fit.arm} ({100 * fit.ratio:.1f} %)" in text
        assert "\n" not in text


def test_auto_says_when_nothing_follows() -> None:
    arms: dict[Arm, Array] = {"PSM1": walk(11), "PSM2": walk(12)}
    [pairing] = pair_over("auto", ("left",), [(COMMANDS, arms)])
    assert min(fit.ratio for fit in pairing.fits) > 0.2
    [text] = pairing.warnings
    assert text.startswith("no arm follows MTML: a static gain leaves ")
    assert text.endswith(f"{pairing.arm} is used")


def test_auto_says_when_both_follow() -> None:
    arms: dict[Arm, Array] = {"PSM1": follower(LEFT, 5, 1.5e-5), "PSM2": follower(LEFT, 6, 1e-5)}
    [pairing] = pair_over("auto", ("left",), [(COMMANDS, arms)])
    assert pairing.arm == "PSM2"
    assert pairing.warnings[0].startswith("both arms follow MTML about equally: a static gain leaves ")
    clear: dict[Arm, Array] = {"PSM1": follower(LEFT, 5, 3e-5), "PSM2": follower(LEFT, 6, 1e-5)}
    assert pair_over("auto", ("left",), [(COMMANDS, clear)])[0].warnings == ()


def test_rows_that_any_map_fits_tell_nothing() -> None:
    for first in range(0, 400, 4):
        few: dict[Arm, Array] = {arm: track[first : first + 4] for arm, track in CROSSED.items()}
        [pairing] = pair_over("auto", ("left",), [({"left": LEFT[first : first + 4]}, few)])
        assert len(pairing.warnings) == 1


def test_an_arm_that_stands_still_follows_nobody() -> None:
    assert fit_arm(LEFT, np.zeros_like(LEFT), "PSM1").ratio == 1.0
    # less than the recordings resolve, even if it looks like following
    assert np.ptp(LEFT) < 0.2
    assert fit_arm(LEFT, 0.1 + 1e-6 * LEFT, "PSM1").ratio == 1.0
    still: dict[Arm, Array] = {"PSM1": np.full_like(LEFT, 0.1), "PSM2": follower(LEFT, 4)}
    assert pair_over("auto", ("left",), [(COMMANDS, still)])[0].arm == "PSM2"
    assert fit_arm(np.full_like(LEFT, 0.1), LEFT, "PSM1").ratio == pytest.approx(1.0)


def test_two_masters_never_share_an_arm() -> None:
    arms: dict[Arm, Array] = {"PSM1": follower(LEFT + RIGHT, 5, 1e-6), "PSM2": walk(12)}
    pairings = pair_over("auto", ("left", "right"), [(COMMANDS, arms)])
    assert [pairing.arm for pairing in pairings] == ["PSM2", "PSM1"]
    for pairing in pairings:
        assert pairing.warnings[0].startswith(
            "both masters seem to drive PSM1: crossed instead; a static gain leaves "
        )


def test_the_description_names_master_arm_and_both_residuals() -> None:
    [pairing] = pair_over("auto", ("left",), [(COMMANDS, CROSSED)])
    text = str(pairing)
    assert text.startswith("MTML -> PSM2 (auto; a static gain leaves ")
    assert text.count("mm rms of PSM") == 2


def test_in_every_real_trial_left_drives_psm2_and_right_psm1_at_half_gain(jigsaws_dir: Path) -> None:
    files = sorted(jigsaws_dir.glob("*/kinematics/AllGestures/*.txt"))
    if not files:
        pytest.skip(f"no trials in {jigsaws_dir}")
    for file in files:
        rows = parse_trial(file.read_text(), file.name)
        seen = rows[:1240]
        commands: dict[Hand, Array] = {"left": position_m(seen, "MTML"), "right": position_m(seen, "MTMR")}
        arms: dict[Arm, Array] = {"PSM1": position_m(seen, "PSM1"), "PSM2": position_m(seen, "PSM2")}
        pairings = pair_over("auto", ("left", "right"), [(commands, arms)])
        assert [pairing.arm for pairing in pairings] == ["PSM2", "PSM1"], file.name
        assert all(pairing.warnings == () for pairing in pairings), file.name
        for master, arm in (("MTML", "PSM2"), ("MTMR", "PSM1")):
            residual_m = position_m(rows, arm) - 0.5 * position_m(rows, master)
            rms_m = np.sqrt(np.mean((residual_m - residual_m.mean(axis=0)) ** 2))
            # an eighth of a millimetre at most, against centimetres of movement
            assert rms_m < 1.25e-4, file.name


def test_recordings_of_different_set_ups_are_pooled_with_a_map_each() -> None:
    turned: dict[Arm, Array] = {arm: np.asarray(5.0 - positions[:, [1, 2, 0]]) for arm, positions in CROSSED.items()}
    alone = pair_over("auto", ("left", "right"), [(COMMANDS, CROSSED)])
    both = pair_over("auto", ("left", "right"), [(COMMANDS, CROSSED), (COMMANDS, turned)])
    for one, two in zip(alone, both, strict=True):
        assert (one.arm, one.warnings) == (two.arm, two.warnings)
        for a, b in zip(one.fits, two.fits, strict=True):
            assert b.ratio == pytest.approx(a.ratio, rel=1e-9)
    # a recording counts by how far its arms move
    small: dict[Arm, Array] = {arm: 0.01 * positions for arm, positions in NAMED.items()}
    most = pair_over("auto", ("left", "right"), [(COMMANDS, CROSSED), (COMMANDS, small)])
    assert [pairing.arm for pairing in most] == ["PSM2", "PSM1"]


def test_a_recording_that_contradicts_a_pairing_adds_a_warning() -> None:
    found = pair_over("auto", ("left", "right"), [(COMMANDS, CROSSED)])
    assert contradictions(found, (COMMANDS, CROSSED), "in a test") == found
    doubted = contradictions(found, (COMMANDS, NAMED), "in a test")
    assert [pairing.arm for pairing in doubted] == ["PSM2", "PSM1"]
    assert doubted[0].warnings[0].startswith("PSM2 is used for MTML as in a test, but PSM1 follows it: ")
