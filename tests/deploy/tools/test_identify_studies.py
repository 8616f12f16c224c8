"""What `tis identify` alone does: NARX beside the linear models, and velocities, which look ahead, as inputs."""

from pathlib import Path

import numpy as np
import pytest

from tests.deploy.commands import Call, call_in_one_line
from tis.common.errors import DataError
from tis.common.scenario.identification import Identification
from tis.common.sources.trajectory import Array, HandRecording, PoseTrack, Recording
from tis.patient_side.identification.identify import identify_with_orders
from tis.patient_side.identification.narx import fit_narx

AHEAD = ("--set", "identification.inputs=[position, velocity]")
ALLOWED = (*AHEAD, "--set", "identification.allow_lookahead=true")


@pytest.fixture
def tis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a function that calls `tis` in an empty folder: exit code, output, diagnostics."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TIS_JIGSAWS", str(tmp_path / "jigsaws"))

    return call_in_one_line


def _track(positions: Array) -> PoseTrack:
    return PoseTrack(positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(positions), 1)), np.zeros(len(positions)))


def _recording(y: Array, u: Array, velocity: Array | None) -> Recording:
    hand = HandRecording("left", "PSM2", _track(u), _track(y), velocity)
    return Recording("made", 30, (hand,), 0, "none")


def test_narx_is_printed_beside_every_linear_method(tis: Call) -> None:
    code, out, err = tis("identify", "default", "--set", "identification.method=narx")
    assert code == 0, err
    for name in ("narx", "moesp", "pi_moesp", "n4sid", "cva", "arx", "error: rms over the movement's deviation"):
        assert name in out


def test_narx_finds_what_no_linear_model_can_be() -> None:
    draw = np.random.default_rng(1)
    u = draw.uniform(-1, 1, (600, 3))
    y = np.zeros((600, 3))
    for k in range(1, 600):
        y[k] = 0.5 * y[k - 1] + u[k - 1] + 0.6 * u[k - 1] * u[k - 1][::-1]
    made = [_recording(y, u, None)]
    study = fit_narx(made, "left", Identification(method="narx", block_rows=5))
    linear = identify_with_orders(made, "left", Identification(block_rows=5), "none")
    assert min(study.fit.fit_pct) > 99.99
    assert max(linear.model.fit_pct) < 99
    assert study.errors[study.model.lags] == min(study.errors.values())


def test_narx_is_refused_where_a_linear_model_is_needed(tis: Call) -> None:
    narx = ("--set", "identification.method=narx")
    for command in ("run", "twin"):
        code, _, err = tis(command, "default", *narx, "--duration-s", "2")
        assert code == 2
        assert "identification: method: must not be narx in a run, whose filters need a linear model" in err
    code, _, err = tis("identify", "default", *narx, "--out", "m.json", "--figure", "f.svg")
    assert code == 2
    assert "--out: requires a linear model" in err
    assert "--figure: requires a linear model" in err
    assert not list(Path().iterdir())


def test_velocities_are_refused_unless_looking_ahead_is_allowed(tis: Call) -> None:
    code, _, err = tis("identify", "default", *AHEAD)
    assert code == 2
    assert "inputs must not contain velocity, whose columns look ahead" in err
    code, _, err = tis("identify", "default", *ALLOWED)
    assert code == 4
    assert "identification: inputs: must be position: this source has no velocity columns" in err
    code, _, err = tis("twin", "default", *ALLOWED, "--duration-s", "2")
    assert code == 2
    assert "inputs: must be position in a run, whose filters receive no velocity" in err


def test_a_trial_s_own_velocities_are_used_and_the_table_says_that_they_look_ahead(tis: Call) -> None:
    code, _, err = tis("synth", "jigsaws", "--trials", "1")
    assert code == 0, err
    file = next(Path("jigsaws").rglob("AllGestures/*.txt"))
    task, trial = file.parents[2].name, file.stem.rpartition("_")[2]
    source = f"source={{kind: jigsaws, path: jigsaws, task: {task}, trial: {trial}, hands: [left]}}"
    code, out, err = tis("identify", "default", "--set", source, "--set", "duration_s=5", *ALLOWED)
    assert code == 0, err
    assert "position and velocity: looks ahead" in out
    assert "the model looks ahead" in err
    code, _, err = tis("identify", "default", "--set", source, "--set", "duration_s=5", *ALLOWED, "--out", "m.json")
    assert code == 2
    assert "--out: holds models for runs, whose filters get no velocity" in err


def test_velocities_explain_an_arm_that_leads_the_commands() -> None:
    # The arm is where the command will be: positions alone tell nothing of it, their slopes do.
    draw = np.random.default_rng(2)
    ahead = np.cumsum(np.cumsum(draw.standard_normal((700, 3)), axis=0), axis=0)
    velocity = np.diff(ahead, axis=0) + 0.1 * draw.standard_normal((699, 3))  # else it follows from later positions
    u, y = ahead[:-1], ahead[1:]
    allowed = Identification(inputs=("position", "velocity"), allow_lookahead=True, block_rows=3, order=0)
    model = identify_with_orders([_recording(y, u, velocity)], "left", allowed, "none").model
    assert np.hstack([np.eye(3), np.eye(3)]) == pytest.approx(model.space.D, abs=0.03)
    assert any("looks ahead" in warning for warning in model.warnings)
    with pytest.raises(DataError, match="no velocity columns"):
        identify_with_orders([_recording(y, u, None)], "left", allowed, "none")
