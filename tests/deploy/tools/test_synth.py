"""`tis synth`: what it writes plays as a JIGSAWS trial does, says what it is, and is there whole or not at all."""

import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console
from typer.testing import CliRunner

from tis.common.errors import EXIT_INVALID_RUN, DataError, InputError
from tis.common.runtime.recordings import list_trials, load_recording, load_training
from tis.common.scenario import Scenario
from tis.common.scenario.patient import PatientPart
from tis.common.scenario.reading import apply_settings, build_scenario, setting
from tis.common.scenario.source import JigsawsSource, SyntheticSource
from tis.common.sources.calibration import RECORDED_SUTURING
from tis.common.sources.jigsaws import trial_text
from tis.common.sources.synthetic import synthesise
from tis.deploy.cli.main import app
from tis.deploy.compare.plan import Request, make_plan
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.summarise import build_summary
from tis.deploy.run.twin import build_sides, run_twin
from tis.deploy.shell.run_dir import create
from tis.deploy.tools import synth


def _scenario(path: Path, **source: Any) -> Scenario:
    raw = {
        "version": 1,
        "name": "s",
        "duration_s": 4,
        "source": {"kind": "jigsaws", "path": str(path), "trial": "S002", **source},
        "network": {"forward": {"delay": {"kind": "constant", "delay_ms": 40}}},
        "identification": {"train_samples": 200},
        "estimators": ["hold", "damped_velocity"],
        "active_estimator": "damped_velocity",
    }
    return build_scenario(raw, "s.yaml")


@pytest.fixture(autouse=True)
def _no_other_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)


@pytest.mark.parametrize("task", ["Suturing", "Knot_Tying"])
def test_a_written_trial_plays_and_is_called_synthetic(tmp_path: Path, task: str) -> None:
    out = tmp_path / "made"
    files = synth.write_trials(out, 2, task, 3, 14.0, "tis synth made")
    folder = out / task / "kinematics" / "AllGestures"
    assert files == [folder / f"{task}_S001.txt", folder / f"{task}_S002.txt"]
    assert {path for path in out.rglob("*") if path.is_file()} == {out / "README.txt", *files}
    readme = (out / "README.txt").read_text()
    assert readme.startswith("SYNTHETIC DATA")
    assert "tis synth made" in readme
    scenario = _scenario(out, task=task, hands=["left", "right"], clock="as_recorded")
    recording = load_recording(scenario)
    assert recording.label == f"{task}_S002 (synthetic)"
    assert [hand.arm for hand in recording.hands] == ["PSM2", "PSM1"]
    assert recording.warnings == ()
    made_by = SyntheticSource(kind="synthetic", hands=("left", "right"), recorder_hz=51.33)
    expected = synthesise(made_by, 3002, 30, 420, 0)
    for read, made in zip(recording.hands, expected.hands, strict=True):
        assert np.abs(read.follower.position_m - made.follower.position_m).max() < 1e-6
    run_dir = create(tmp_path / "run", scenario)
    nodes, models, _ = build_sides(scenario)
    run_twin(scenario, nodes, models, run_dir)
    summary = build_summary(load_run(run_dir), scenario, models, "twin", 0, "")
    assert summary["problems"] == []
    assert summary["source"] == f"synthetic {task} S002, left and right hand"
    assert load_training(scenario, recording)[0].label == recording.label


def test_the_same_seed_writes_the_same_bytes_and_each_trial_is_another(tmp_path: Path) -> None:
    one, again, other = (
        [file.read_bytes() for file in synth.write_trials(tmp_path / name, 2, "Suturing", seed, 3.0, "")]
        for name, seed in (("one", 1), ("again", 1), ("other", 2))
    )
    assert one == again
    assert len({*one, *other}) == 4


def test_a_folder_that_holds_anything_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(DataError, match="must be new or empty"):
        synth.write_trials(tmp_path, 1, "Suturing", 1, 3.0, "")
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
    (tmp_path / "empty").mkdir()
    assert len(synth.write_trials(tmp_path / "empty", 1, "Suturing", 1, 3.0, "")) == 1
    with pytest.raises(DataError):
        synth.write_trials(tmp_path / "notes.txt", 1, "Suturing", 1, 3.0, "")


def test_what_fails_half_way_leaves_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(recording: object) -> str:
        raise OSError(28, "No space left on device")

    (tmp_path / "empty").mkdir()
    monkeypatch.setattr(synth, "trial_text", full)
    for name in ("new", "empty"):
        with pytest.raises(DataError, match="cannot be written: No space left on device"):
            synth.write_trials(tmp_path / name, 2, "Suturing", 1, 3.0, "")
    assert [path.name for path in tmp_path.rglob("*")] == ["empty"]


def test_all_wrong_options_are_named_at_once(tmp_path: Path) -> None:
    for duration_s in (0.05, float("nan"), float("inf")):
        with pytest.raises(InputError) as caught:
            synth.write_trials(tmp_path / "out", 1000, "Sewing", -1, duration_s, "", 9)
        fields = [fault.field for fault in caught.value.faults]
        assert fields == ["--people", "--trials", "--task", "--seed", "--duration-s"]
    assert list(tmp_path.iterdir()) == []


def test_the_check_prints_each_figure_and_fails_when_one_is_off(monkeypatch: pytest.MonkeyPatch) -> None:
    console = Console(record=True, width=100)
    assert synth.print_calibration(1, console) == 0
    text = console.export_text()
    assert "speed p99, mm/s" in text
    assert "angular speed p99, deg/s" in text
    assert "all within 25 %" in text
    monkeypatch.setitem(RECORDED_SUTURING, "speed p99, mm/s", 30.0)
    assert synth.print_calibration(1, console) == EXIT_INVALID_RUN
    assert "1 of 38 outside 25 %" in console.export_text()


def test_the_command_needs_a_folder_or_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, ["synth"])
    assert result.exit_code == 2
    assert "OUT_FOLDER: is required, or --check" in result.stderr
    result = CliRunner().invoke(app, ["synth", "made", "--trials", "1", "--duration-s", "2"])
    assert result.exit_code == 0
    assert "path: made" in result.stdout
    assert (tmp_path / "made" / "Suturing" / "kinematics" / "AllGestures" / "Suturing_S001.txt").is_file()


@pytest.fixture(scope="module")
def people(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with two trials of each of three people."""
    out = tmp_path_factory.mktemp("synth") / "her, {people}"
    options = ["--people", "3", "--trials", "2", "--seed", "7", "--duration-s", "14"]
    result = CliRunner().invoke(app, ["synth", str(out), *options])
    assert result.exit_code == 0
    assert result.stdout.startswith(f"6 synthetic trials in {out}; play one with\n")
    words = shlex.split(result.stdout.splitlines()[-1])
    assert words[:4] == ["tis", "compare", "default", "--set"]
    source = {"kind": "jigsaws", "path": str(out), "task": "Suturing"}
    assert apply_settings({}, words[4:]) == {"source": source}
    return out


def test_each_person_has_a_letter_and_is_estimated_with_models_of_the_others(people: Path) -> None:
    names = ["S001", "S002", "T001", "T002", "U001", "U002"]
    scenario = _scenario(people, trial="T002")
    assert isinstance(scenario.source, JigsawsSource)
    assert list_trials(scenario.source) == names
    assert scenario.source.synthetic
    others = scenario.model_copy(
        update={"identification": scenario.identification.model_copy(update={"train": "others"})}
    )
    recording = load_recording(others)
    assert (recording.label, recording.warnings, recording.anomalies) == ("Suturing_T002 (synthetic)", (), ())
    trainings = load_training(others, recording)
    assert [each.label[9:13] for each in trainings] == [name for name in names if name[0] != "T"]
    assert all(each.label.endswith(" (synthetic)") and len(each.hands) == 2 for each in trainings)
    plan = make_plan(
        Request("default", (setting("source", {"kind": "jigsaws", "path": str(people)}),), ("hold", "innovations_kf"))
    )
    assert plan.trials == tuple(names)
    assert plan.trained_on == "the same task by all other subjects"
    assert len(plan.trainings) == 3


def test_the_readme_names_each_person_so_that_a_trial_can_be_repeated(people: Path) -> None:
    text = (people / "README.txt").read_text()
    assert text.startswith("SYNTHETIC DATA")
    lines = dict(line.strip().split(": ", 1) for line in text.splitlines() if re.match(r"    [S-Z]: ", line))
    assert list(lines) == ["S", "T", "U"]
    source = SyntheticSource.model_validate(yaml.safe_load(lines["T"]))
    repeated = synthesise(source, 7_002_001, 30, 420, 0)
    file = people / "Suturing" / "kinematics" / "AllGestures" / "Suturing_T001.txt"
    assert file.read_text() == trial_text(repeated)


def test_the_people_of_a_smaller_folder_are_the_first_of_a_larger_one(tmp_path: Path, people: Path) -> None:
    files = synth.write_trials(tmp_path / "one", 1, "Suturing", 7, 14.0, "", 1)
    assert [file.name for file in files] == ["Suturing_S001.txt"]
    assert files[0].read_bytes() == next(people.rglob("Suturing_S001.txt")).read_bytes()


def test_the_arm_of_a_scenario_executes_the_movements(tmp_path: Path) -> None:
    plain, executed = tmp_path / "plain", tmp_path / "executed"
    synth.write_trials(plain, 2, "Suturing", 3, 20.0, "tis synth")
    arm = _scenario(plain).model_copy(
        update={"patient": PatientPart.model_validate({"plant": {"kind": "servo", "bandwidth_hz": 2}})}
    )
    files = synth.write_trials(executed, 2, "Suturing", 3, 20.0, "tis synth", arm=arm)
    before, after = (
        load_recording(_scenario(path, trial="S001", clock="as_recorded")).hands[0] for path in (plain, executed)
    )
    assert np.array_equal(after.command.position_m, before.command.position_m)
    lags = [
        np.linalg.norm(after.follower.position_m[9:] - before.follower.position_m[9 - lag : -lag]) for lag in (1, 4)
    ]
    assert lags[1] < 0.5 * lags[0]  # a critically damped servo of 2 Hz is 160 ms behind
    assert "bandwidth_hz: 2.0" in (executed / "README.txt").read_text()
    assert [file.name for file in files] == ["Suturing_S001.txt", "Suturing_S002.txt"]


def test_settings_without_an_arm_and_an_arm_that_executes_nothing_are_refused(tmp_path: Path) -> None:
    folder = str(tmp_path / "none")
    done = CliRunner().invoke(app, ["synth", folder, "--set", "patient.plant.kind=servo"])
    assert done.exit_code == 2
    assert "tis synth: --set: must be given with --plant" in done.stderr
    done = CliRunner().invoke(app, ["synth", folder, "--plant", "default"])
    assert done.exit_code == 2
    assert "patient.plant: kind: must be servo or mujoco" in done.stderr
    assert not (tmp_path / "none").exists()
