"""What a user's mistake gets: one line for each, the right exit code, no traceback, nothing half-written."""

import json
import os
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from shutil import copytree, ignore_patterns

import pytest

from tests.deploy.commands import Call, call
from tests.log_reader import cut

HEAD = "version: 1\nname: s\nduration_s: 4\nsource: {kind: synthetic}\n"


@pytest.fixture
def tis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a function that calls `tis` in an empty folder: exit code, output, diagnostics."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)

    return call


@pytest.fixture(scope="module")
def twin_of_4_s(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a twin of 4 s with its merged file, without a report; not to be changed."""
    path = tmp_path_factory.mktemp("twin") / "r"
    assert call("twin", "default", "--duration-s", "4", "--run-dir", str(path), "--no-report")[0] == 0
    return path


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (HEAD + "fnord: 1\n", "tis: s.yaml: line 5: fnord: unknown key (got 1)"),
        (
            HEAD + "network: {forward: {delay: {kind: constant, delay_ms: -3}}}\n",
            "tis: s.yaml: line 5: network.forward.delay.delay_ms: must be at least 0 (got -3)",
        ),
        ("- a\n- b\n", "tis: s.yaml: must be a mapping of keys to values (got ['a', 'b'])"),
        (HEAD + "seed: 1\nseed: 2\n", "tis: s.yaml: line 6"),
    ],
)
@pytest.mark.parametrize("command", ["run", "twin", "validate", "surgeon", "identify"])
def test_a_bad_scenario_is_one_line_and_leaves_nothing(
    tis: Call, tmp_path: Path, text: str, line: str, command: str
) -> None:
    Path("s.yaml").write_text(text)
    code, out, err = tis(command, "s.yaml")
    assert code == 2
    assert line.removeprefix("tis: ") in err
    assert len(err.strip().splitlines()) == 1
    assert out == ""
    assert [path.name for path in tmp_path.iterdir()] == ["s.yaml"]


def test_all_faults_of_a_file_come_at_once(tis: Call) -> None:
    Path("s.yaml").write_text(HEAD + "fnord: 1\nseed: -1\nrate_hz: x\n")
    code, _, err = tis("validate", "s.yaml")
    assert code == 2
    assert {line.split(": ")[3] for line in err.strip().splitlines()} == {"seed", "rate_hz", "fnord"}


def test_an_unknown_scenario_names_the_shipped_ones(tis: Call) -> None:
    code, _, err = tis("run", "paper_7")
    assert code == 2
    assert "no such scenario" in err
    assert "paper_6" in err


def test_a_folder_that_is_no_scenario_says_how_a_recording_in_it_is_read(tis: Call) -> None:
    Path("a bag").mkdir()
    code, _, err = tis("run", "a bag")
    assert code == 2
    assert "is a folder, not a scenario: of a recording `tis import 'a bag' --out 'a bag_table.csv'`" in err


def test_settings_change_a_scenario_and_are_checked(tis: Call) -> None:
    words = ["--set", "network.forward.delay.delay_ms=7", "--seed", "3", "--duration-s", "2"]
    code, out, _ = tis("validate", "default", *words)
    assert code == 0
    assert "delay_ms: 7.0" in out
    assert "seed: 3" in out
    assert "duration_s: 2.0" in out
    code, _, err = tis("validate", "default", "--set", "network.forward.delay.delay_ms=-7")
    assert code == 2
    assert "network.forward.delay.delay_ms" in err


def test_the_schema_is_json_and_describes_every_scenario_key(tis: Call) -> None:
    code, out, _ = tis("validate", "--schema")
    assert code == 0
    schema = json.loads(out)
    assert schema["properties"]["seed"]["description"]


@pytest.mark.parametrize("command", ["twin", "run"])
def test_missing_data_says_what_it_is_and_where_it_was_looked_for(tis: Call, tmp_path: Path, command: str) -> None:
    code, _, err = tis(command, "paper_3")
    assert code == 4
    assert "JIGSAWS" in err
    assert str(tmp_path) in err
    assert "starting" not in err  # no process was
    assert not (tmp_path / "runs").exists()


def test_a_model_file_that_is_not_there_is_said_before_any_process_starts(tis: Call, tmp_path: Path) -> None:
    code, _, err = tis("run", "default", "--set", "identification.train=nowhere.json")
    assert code == 4
    assert "nowhere.json: model file cannot be read" in " ".join(err.split())
    assert "starting" not in err
    assert not (tmp_path / "runs").exists()


def _trial(change: Callable[[list[list[str]]], None]) -> None:
    rows = [[f"{0.001 * (i + j):.6f}" for j in range(76)] for i in range(1600)]
    for row in rows:
        for first in (3, 22, 41, 60):
            row[first : first + 9] = ["1", "0", "0", "0", "1", "0", "0", "0", "1"]
    change(rows)
    folder = Path("data/jigsaws/Suturing/kinematics/AllGestures")
    folder.mkdir(parents=True)
    (folder / "Suturing_D002.txt").write_text("\n".join(" ".join(row) for row in rows))


def _cut_column(rows: list[list[str]]) -> None:
    for row in rows:
        del row[-1]


def _put_nan(rows: list[list[str]]) -> None:
    rows[700][2] = "NaN"


def _shorten(rows: list[list[str]]) -> None:
    del rows[1300:]


@pytest.mark.parametrize(
    ("command", "change", "words"),
    [
        ("run", _cut_column, "75"),
        ("twin", _put_nan, "701"),
        ("twin", list.clear, "empty"),
        ("twin", _shorten, "1300"),
    ],
    ids=["75 columns", "NaN", "empty", "too short"],
)
def test_a_damaged_trial_is_one_line_naming_the_place(
    tis: Call, tmp_path: Path, command: str, change: Callable[[list[list[str]]], None], words: str
) -> None:
    _trial(change)
    code, _, err = tis(command, "paper_3")
    assert code == 4
    assert words in err
    assert "Suturing_D002" in err
    assert not (tmp_path / "runs").exists() or not list((tmp_path / "runs").iterdir())


def test_a_run_folder_that_holds_something_is_not_touched(tis: Call, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "thesis.txt").write_text("precious")
    code, _, err = tis("twin", "default", "--run-dir", "mine")
    assert code == 4
    assert "mine: run folder must be new or empty" in err
    assert [path.name for path in (tmp_path / "mine").iterdir()] == ["thesis.txt"]


@pytest.mark.parametrize("command", ["run", "twin"])
def test_an_unwritable_run_folder_is_one_line(tis: Call, tmp_path: Path, command: str) -> None:
    Path("file").write_text("")
    code, _, err = tis(command, "default", "--run-dir", "file/run")
    assert code == 4
    assert "run folder cannot be created: Not a directory" in err
    assert len(err.strip().splitlines()) == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_without_permission_is_one_line(tis: Call, tmp_path: Path) -> None:
    (tmp_path / "locked").mkdir(mode=0o500)
    code, _, err = tis("twin", "default", "--run-dir", "locked/run")
    assert code == 4
    assert "Permission denied" in err


def test_a_twin_writes_a_run_that_info_and_replay_read(tis: Call) -> None:
    code, out, _ = tis("twin", "default", "--duration-s", "4", "--run-dir", "r")
    assert code == 0
    assert "innovations_kf" in out
    names = {path.name for path in Path("r").iterdir()}
    assert names == {
        "scenario.yaml", "summary.json", "manifest.json", "model.json", "report.html",
        "surgeon.mcap", "netem.mcap", "patient.mcap", "run.mcap",
    }  # fmt: skip
    code, out, _ = tis("replay", "r")
    assert code == 0
    assert "identical, bit for bit" in out
    code, out, _ = tis("info", "r")
    assert code == 0
    assert "complete" in out


def test_a_damaged_log_never_replays_as_identical(tis: Call, twin_of_4_s: Path) -> None:
    copytree(twin_of_4_s, "r", ignore=ignore_patterns("run.mcap"))
    cut(Path("r/patient.mcap"))
    code, out, err = tis("replay", "r")
    assert code == 5
    assert "0 differ" in out
    assert "the readable part is identical, bit for bit, but the log does not hold the whole run" in out
    assert "patient: log is damaged (the file ends early" in err
    assert "only the readable part was replayed" in err
    assert tis("recover", "r/patient.mcap")[0] == 3
    code, out, err = tis("replay", "r")
    assert code == 5
    assert "0 differ" in out
    assert "log was recovered from a damaged one (patient_recovered.mcap)" in err


def test_a_twin_is_held_against_what_a_damaged_log_still_tells_and_says_so(tis: Call, twin_of_4_s: Path) -> None:
    copytree(twin_of_4_s, "r", ignore=ignore_patterns("run.mcap"))
    log = Path("r/netem.mcap")
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    words = ("--duration-s", "4", "--against", "r", "--run-dir", "again", "--no-report", "--no-merge")
    code, out, err = tis("twin", "default", *words)
    assert code == 0
    assert "0 differ" in out
    assert "tis: r: netem: log is damaged (the file ends early" in err
    assert "only the readable part was compared" in err


def test_gathered_logs_can_be_looked_at_before_they_are_summarised(tis: Call, twin_of_4_s: Path) -> None:
    copytree(twin_of_4_s, "r")
    for name in ("scenario.yaml", "summary.json", "manifest.json", "model.json"):
        Path("r", name).unlink()
    code, out, _ = tis("info", "r")
    assert code == 0
    assert "see tis summarize" in out
    assert "complete" in out


def test_a_side_finds_a_shipped_scenario(tis: Call) -> None:
    code, _, err = tis("surgeon", "default")
    assert code == 2
    assert "auto works in `tis run` only" in err
    code, _, err = tis("surgeon", "fnord")
    assert code == 2
    assert "no such scenario" in err


def test_recover_tells_lossy_from_whole(tis: Call, twin_of_4_s: Path) -> None:
    copytree(twin_of_4_s, "r", ignore=ignore_patterns("run.mcap"))
    code, out, _ = tis("recover", "r/patient.mcap")
    assert code == 0
    assert "nothing to recover" in " ".join(out.split())
    assert not Path("r/patient_recovered.mcap").exists()
    whole = Path("r/netem.mcap").read_bytes()
    Path("cut.mcap").write_bytes(whole[: len(whole) // 2])
    code, out, err = tis("recover", "cut.mcap")
    assert code == 3
    assert "was damaged: the file ends early" in err
    assert Path("cut_recovered.mcap").is_file()
    code, _, err = tis("recover", "cut.mcap")
    assert code == 4
    assert "exists already" in err


def test_an_identified_model_serves_as_training(tis: Call) -> None:
    code, out, _ = tis("identify", "default", "--out", "m.json")
    assert code == 0
    assert "static" in out
    words = ("--duration-s", "4", "--run-dir", "r", "--no-report", "--no-merge")
    code, out, err = tis("twin", "default", "--set", "identification.train=m.json", *words)
    assert code == 0, err
    assert json.loads(Path("r/summary.json").read_text())["identification"]["order"] == 0
    code, _, err = tis("twin", "default", "--set", "identification.train=absent.json")
    assert code == 4
    assert "absent.json: model file cannot be read: No such file" in err
    Path("bad.json").write_text("{}")
    code, _, err = tis("twin", "default", "--set", "identification.train=bad.json")
    assert code == 4
    assert "bad.json" in err


def test_a_folder_that_is_no_run_is_said_so(tis: Call) -> None:
    Path("empty").mkdir()
    for command in ("replay", "info", "summarize"):
        code, _, err = tis(command, "empty")
        assert code == 4
        assert "is no run folder" in err


def test_a_side_alone_needs_to_know_where_netem_is(tis: Call) -> None:
    Path("s.yaml").write_text(HEAD)
    code, _, err = tis("surgeon", "s.yaml")
    assert code == 2
    assert "auto works in `tis run` only: give hosts or --connect" in err


def test_a_side_gives_up_after_its_patience(tis: Call) -> None:
    Path("s.yaml").write_text(HEAD)
    code, _, err = tis("surgeon", "s.yaml", "-e", "tcp/127.0.0.1:9", "--wait-s", "0.5")
    assert code == 3
    assert "waiting for netem at tcp/127.0.0.1:9" in err
    assert "did not answer within 0.5 s" in err


def test_the_version_is_that_of_the_package(tis: Call) -> None:
    code, out, _ = tis("--version")
    assert (code, out) == (0, f"tis {version('tis-testbed')}, eclipse-zenoh {version('eclipse-zenoh')}\n")
