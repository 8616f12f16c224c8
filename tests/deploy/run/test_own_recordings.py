"""One's own recordings and model files from the command line: what is read is said, and what spoils it too."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.common.runtime.recordings.tables import movement, write_csv
from tests.common.sources.trials import FIRST, text_of
from tests.deploy.commands import Call, call_in_one_line
from tis.common.scenario.reading import parse_yaml
from tis.common.sources.jigsaws import parse_trial
from tis.deploy.present.numbers import number
from tis.deploy.tools.synth import write_trials

MODEL = "identification.train=m.json"
SCENARIO = """version: 1
name: own
duration_s: 4
drain_s: 0.2
source: {kind: jigsaws, path: own, trial: S001, hands: [left]}
network: {forward: {delay: {kind: constant, delay_ms: 100}}}
identification: {train_samples: 150, block_rows: 4, order: 0}
estimators: [hold, damped_velocity]
active_estimator: damped_velocity
patient: {orientation: {methods: [hold], active: hold}}
"""


@pytest.fixture(scope="session")
def two_folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the folders own and other, whose trials S001 and S002 are of the same names, 500 rows."""
    folder = tmp_path_factory.mktemp("folders")
    for seed, name in enumerate(("own", "other")):
        write_trials(folder / name, 2, "Suturing", seed, 500 / 30, "a test")
    return folder


@pytest.fixture
def tis(tmp_path: Path, two_folders: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a function that calls `tis` where own/ and own.yaml lie while TIS_JIGSAWS names the other folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("TIS_JIGSAWS", str(two_folders / "other"))
    (tmp_path / "own").symlink_to(two_folders / "own")
    (tmp_path / "own.yaml").write_text(SCENARIO)

    return call_in_one_line


def twin(tis: Call, run_dir: str, *settings: str) -> tuple[dict[str, Any], str, str]:
    words = [word for setting in settings for word in ("--set", setting)]
    code, out, err = tis("twin", "own.yaml", "--run-dir", run_dir, "--no-report", "--no-merge", "-v", *words)
    assert code == 0, err
    return json.loads(Path(run_dir, "summary.json").read_text()), out, err


def rewrite(name: str, change: Callable[[Any], object]) -> None:
    """Write the trial S001 of own/ changed into a folder of its own."""
    below = Path("Suturing", "kinematics", "AllGestures", "Suturing_S001.txt")
    rows = parse_trial(Path("own", below).read_text(), "own")
    change(rows)
    Path(name, below).parent.mkdir(parents=True)
    Path(name, below).write_text(text_of(rows))


def test_a_path_that_is_given_is_read_and_recorded_whatever_the_environment_says(
    tis: Call, two_folders: Path
) -> None:
    own, _, err = twin(tis, "given")
    assert "warning" not in err
    named, _, _ = twin(tis, "named", "source.path=null")
    assert own["recording"]["file"].startswith(str(Path.cwd() / "own"))
    assert named["recording"]["file"].startswith(str(two_folders / "other"))
    assert own["recording"]["digest"] != named["recording"]["digest"]
    for run_dir, path in (("given", "own"), ("named", str(two_folders / "other"))):
        assert parse_yaml(Path(run_dir, "scenario.yaml").read_text(), run_dir)["source"]["path"] == path
    again, _, _ = twin(tis, "again", f"source.path={two_folders / 'other'}")
    assert again["recording"] == named["recording"]
    assert again["accuracy"] == named["accuracy"]


def test_sides_that_have_read_different_recordings_do_not_make_a_valid_run(
    tis: Call, two_folders: Path, without_report: None
) -> None:
    twin(tis, "one")
    twin(tis, "two", f"source.path={two_folders / 'other'}")
    Path("two/patient.mcap").replace("one/patient.mcap")
    code, out, _ = tis("summarize", "one")
    assert code == 5
    summary = json.loads(Path("one/summary.json").read_text())
    [problem] = [text for text in summary["problems"] if text.startswith("recording: ")]
    assert problem.startswith("recording: surgeon and patient have read different ones (surgeon: ")
    assert "recording: surgeon and patient" in out


def test_what_synth_prints_plays(tis: Call) -> None:
    _, out, _ = tis("synth", "made", "--trials", "1", "--duration-s", "20")
    source = out.partition("source: ")[2]
    summary, _, _ = twin(tis, "r", f"source={source}")
    assert "/made/" in summary["recording"]["file"]


def test_a_model_that_has_seen_what_is_played_is_no_test_and_says_so(tis: Call) -> None:
    code, out, err = tis("identify", "own.yaml", "--out", "m.json")
    assert code == 0, err
    assert "own_head: rows 0-149 of Suturing_S001" in out
    assert "source.start=150" in out
    text = (
        "in sample: the model of m.json was trained on rows 0-149 of Suturing_S001 (synthetic), and this run plays "
    )
    summary, out, err = twin(tis, "seen", MODEL)
    assert [one.startswith(text + "rows 0-120 of them") for one in summary["in_sample"]] == [True]
    assert text not in out  # it was told before the run
    assert text in err
    assert "trained on m.json (own_head: rows 0-149 of Suturing_S001 (synthetic))" in out
    assert summary["identification"]["model_file"] == "m.json"
    for run_dir, setting in (("behind", "source.start=150"), ("second", "source.trial=S002")):
        summary, out, err = twin(tis, run_dir, MODEL, setting)
        assert summary["in_sample"] == []
        assert "in sample" not in out + err


def test_the_report_and_a_comparison_say_it_too(tis: Call, in_this_process: None) -> None:
    tis("identify", "own.yaml", "--out", "m.json")
    code, _, err = tis("twin", "own.yaml", "--set", MODEL, "--run-dir", "r", "--no-merge")
    assert code == 0, err
    page = Path("r/report.html").read_text()
    assert "in sample: the model of m.json was trained on rows 0-149" in page
    assert "m.json (own_head: rows 0-149" in page
    code, _, err = tis("compare", "own.yaml", "--set", MODEL, "--jobs", "1", "--out", "c", "--trials", "S001,S002")
    assert code == 0, err
    assert err.count("in sample: ") == 1
    assert "Warning: in sample: the model of m.json" in Path("c/table.md").read_text()
    code, _, err = tis("compare", "own.yaml", "--jobs", "1", "--out", "d", "--trials", "S001")
    assert code == 0, err
    assert "in sample" not in err


def test_a_model_of_another_arm_is_refused_before_anything_is_written(tis: Call) -> None:
    twin(tis, "other", "source.pairing=same_name")
    code, _, err = tis("twin", "own.yaml", "--set", "identification.train=other/model.json", "--run-dir", "r")
    assert code == 4
    assert "other/model.json: arm: must be PSM2, which the left hand drives in this run" in err
    assert "(got 'PSM1')" in err
    assert not Path("r").exists()


def test_damage_is_said_wherever_a_recording_is_read_and_kept(tis: Call, in_this_process: None) -> None:
    def in_millimetres(rows: Any) -> None:
        for first in FIRST.values():
            rows[:, first : first + 3] *= 1000

    rewrite("mm", in_millimetres)
    said = "MTML moves over"
    code, out, _ = tis("twin", "own.yaml", "--run-dir", "no", "--no-report", "--no-merge", "--set", "source.path=mm")
    assert code == 5
    assert "the patient did not use" in out
    limits = "patient.gate={reach_m: 1000, speed_m_s: 1.e+5, acceleration_m_s2: 1.e+7}"
    summary, out, err = twin(tis, "r", "source.path=mm", limits)
    assert "are these millimetres?" in err
    assert said not in out
    assert said in " ".join(summary["recording"]["warnings"])
    for command in ("identify", "compare"):
        settings = ("source.path=mm", "source.trial=S001", limits)
        code, _, err = tis(command, "own.yaml", *(f"--set={one}" for one in settings))
        assert code == 0
        assert err.count(said) == 1


def test_what_a_model_was_trained_on_is_looked_at_as_well(tis: Call) -> None:
    def filled_in(rows: Any) -> None:
        rows[300:330, :3] = 0.0

    rewrite("others", filled_in)
    folder = Path("others/Suturing/kinematics/AllGestures")
    Path(folder, "Suturing_T001.txt").write_text(
        Path("own/Suturing/kinematics/AllGestures/Suturing_S002.txt").read_text()
    )
    train = ("source.path=others", "source.trial=T001", "identification.train=others")
    summary, _, err = twin(tis, "r", *train)
    zeros = "trained on Suturing_S001 (synthetic): MTML is at exactly 0 0 0 in rows 300-329"
    assert zeros in err
    assert zeros in " ".join(summary["identification"]["warnings"])
    (paired,) = summary["recording"]["warnings"]
    assert "in the training trials, no arm follows MTML" in paired
    assert summary["identification"]["trained_on"][0] | {"digest": ""} == {
        "label": "Suturing_S001 (synthetic)", "digest": "", "first_row": 0, "n_rows": 500, "rate_hz": 30,
    }  # fmt: skip


def test_settings_without_effect_are_said(tis: Call) -> None:
    _, _, err = tis("identify", "own.yaml", "--out", "m.json", "--set", "patient.plant.kind=servo")
    assert "patient.plant has no effect here: the model describes the recorded arm, not the servo" in err
    _, _, err = twin(tis, "r", MODEL, "identification.method=n4sid", "identification.allow_lookahead=true")
    assert "identification.method has no effect: the model comes from m.json, where it was found by moesp" in err
    assert "identification.allow_lookahead has no effect" in err


def test_a_smooth_path_is_not_told_to_do_without_a_recorder(tis: Call) -> None:
    code, _, err = tis("twin", "kilohertz", "--duration-s", "3", "--set", "identification.method=moesp")
    assert code == 4
    assert "choose method arx or fewer block rows" in err
    assert "recorder_hz" not in err


def test_a_comma_separated_file_is_told_what_to_use(tis: Call) -> None:
    rewrite("csv", lambda _: None)
    file = Path("csv/Suturing/kinematics/AllGestures/Suturing_S001.txt")
    np.savetxt(file, np.loadtxt(file), delimiter=",")
    code, _, err = tis("twin", "own.yaml", "--set", "source.path=csv")
    assert code == 4
    assert "all 500 lines: must have 76 columns, separated by spaces and not by commas (got 1)" in err


def test_a_table_of_a_larger_arm_is_valid_as_it_is(tis: Call) -> None:
    noise = np.random.default_rng(1)
    columns = {
        name: 60.0 * one + noise.normal(0.0, 1e-3, len(one)) if name.endswith("_m") else one
        for name, one in movement(600, rate_hz=50.0).items()
    }
    write_csv(Path("drone.csv"), columns)
    settings = ("source={kind: table, path: drone.csv}", "rate_hz=50", "identification.train_samples=300")
    summary, out, err = twin(tis, "r", *settings)
    assert summary["valid"]
    assert not any(summary["quarantined"].values())
    safety = summary["safety"]["left"]
    assert safety["shaped_ticks"] == safety["limited"]["ticks"] <= 2
    assert safety["rmse_3d_mm"] == safety["estimate_rmse_3d_mm"]
    assert "kept off" not in out + err
    summary, out, err = twin(tis, "s", *settings, "patient.safety={workspace_m: 0.2}")
    limited = summary["safety"]["left"]["limited"]
    assert summary["valid"]
    assert limited["field"] == "workspace_m"
    assert limited["ticks"] > 0.01 * 200
    assert limited["by_movement"]
    off = f"by up to {number(limited['off_mm'])} mm: the movement itself goes beyond patient.safety.workspace_m"
    assert off in " ".join((out + err).split())
    code, out, _ = tis("twin", "own.yaml", "--run-dir", "x", "--no-report", "--no-merge", *(
        f"--set={one}" for one in (*settings, "patient.gate={reach_m: 0.5}")
    ))  # fmt: skip
    assert code == 5
    assert "if they are right, raise patient.gate.reach_m" in out
