"""``tis info``, ``merge``, ``recover``, ``export`` on good and bad inputs: one line each, the right exit code."""

from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import pytest
from typer.testing import CliRunner

from deploy.cli import app
from tests.deploy.logs.conftest import run_dir, scenario, write_ros2

__all__ = ["run_dir", "scenario"]

Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def tis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a function that calls `tis` in an empty folder: exit code, output, diagnostics."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "150")

    def call(*words: str) -> tuple[int, str, str]:
        result = CliRunner().invoke(app, list(words))
        assert "Traceback" not in result.output
        return result.exit_code, result.stdout, result.stderr

    return call


@pytest.fixture
def run(run_dir: Path, tmp_path: Path) -> Path:
    """Return a copy of the run, to be damaged; beside the tests' own folder."""
    return Path(copytree(run_dir, tmp_path / "r"))


def _one_line(err: str) -> str:
    lines = err.strip().splitlines()
    assert len(lines) == 1, err
    return lines[0]


def test_info_shows_the_merged_file_of_a_run(tis: Call, run: Path) -> None:
    code, out, err = tis("info", "r")
    assert (code, err) == (0, "")
    assert sum(".mcap" in line and "complete" in line for line in out.splitlines()) == 4
    code, out, err = tis("info", "r/run.mcap")
    assert (code, err) == (0, "")
    for words in ("foxglove.PoseInFrame", "tis.EstimateNote", "/mtm", "scenario default", "attached: scenario.yaml"):
        assert words in out


def test_info_shows_other_peoples_files(tis: Call) -> None:
    write_ros2(Path("bag.mcap"))
    code, out, err = tis("info", "bag.mcap")
    assert (code, err) == (0, "")
    for words in ("100 messages over 0.990 s from 2023-11-14", "somebody's recorder 1.2, profile ros2", "/chatter"):
        assert words in out
    for words in ("std_msgs/msg/String", "cdr", "100.0", "metadata rosbag2: version 9", "notes.txt"):
        assert words in out


def test_other_peoples_files_are_no_log_of_a_run(tis: Call, run: Path) -> None:
    write_ros2(run / "netem.mcap")
    before = (run / "run.mcap").read_bytes()
    code, _, err = tis("merge", "r")
    assert code == 4
    assert 'is no log of tis, but of "somebody\'s recorder 1.2"' in _one_line(err)
    assert (run / "run.mcap").read_bytes() == before
    code, _, err = tis("export", "r", "--csv")
    assert code == 3
    assert "netem: log is damaged (is no log of tis" in _one_line(err)


@pytest.mark.parametrize("command", [("info", "x.mcap"), ("recover", "x.mcap")])
@pytest.mark.parametrize("content", [b"", b"no log", b"PK\x03\x04" + bytes(500)])
def test_a_file_that_is_not_mcap_is_one_line(tis: Call, command: tuple[str, str], content: bytes) -> None:
    Path("x.mcap").write_bytes(content)
    code, out, err = tis(*command)
    assert (code, out) == (4, "")
    assert _one_line(err) == "tis: x.mcap: is no MCAP file"
    assert [path.name for path in Path().iterdir()] == ["x.mcap"]


@pytest.mark.parametrize("command", ["info", "recover"])
def test_a_file_that_is_not_there_is_one_line(tis: Call, command: str) -> None:
    code, _, err = tis(command, "x.mcap")
    assert code == 4
    assert _one_line(err) == "tis: x.mcap: cannot be read: No such file or directory"


def test_a_truncated_file_is_shown_as_far_as_it_goes(tis: Call, run: Path) -> None:
    merged = run / "run.mcap"
    merged.write_bytes(merged.read_bytes()[: merged.stat().st_size * 2 // 3])
    code, out, err = tis("info", "r/run.mcap")
    assert code == 3
    assert "/patient/tis/ticks" in out
    assert "is damaged: the file ends early" in _one_line(err)
    assert "see tis recover" in err


def test_recover_says_what_was_lost(tis: Call, run: Path) -> None:
    code, out, err = tis("recover", "r/patient.mcap")
    assert (code, err) == (0, "")
    assert "r/patient_recovered.mcap" in out
    log = run / "netem.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    code, _, err = tis("recover", "r/netem.mcap")
    assert code == 3
    assert "was damaged: the file ends early" in _one_line(err)
    code, _, err = tis("recover", "r/netem.mcap")
    assert code == 4
    assert "exists already" in _one_line(err)


def test_merge_of_a_run_without_netem_s_log_is_said_to_be_in_part(tis: Call, run: Path) -> None:
    (run / "netem.mcap").unlink()
    code, out, err = tis("merge", "r")
    assert code == 3
    assert "Merged: r/run.mcap" in out
    assert "r: netem.mcap is missing or empty; what is there was merged" in _one_line(err)
    code, out, err = tis("info", "r")
    assert code == 0
    assert _one_line(err) == "tis: r: netem.mcap is missing"


def test_merge_of_a_damaged_log_is_said_to_be_in_part(tis: Call, run: Path) -> None:
    log = run / "patient.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    code, _, err = tis("merge", "r")
    assert code == 3
    assert "patient.mcap is damaged (the file ends early" in _one_line(err)


@pytest.mark.parametrize("command", [("merge", "r"), ("export", "r", "--csv")])
def test_an_empty_run_has_nothing_to_merge_or_export(tis: Call, run: Path, command: tuple[str, ...]) -> None:
    for log in run.glob("*.mcap"):
        log.unlink()
    before = sorted(path.name for path in run.iterdir())
    code, out, err = tis(*command)
    assert (code, out) == (4, "")
    assert "holds no log" in _one_line(err)
    assert sorted(path.name for path in run.iterdir()) == before


@pytest.mark.parametrize("command", [("merge", "e"), ("export", "e", "--csv"), ("info", "e")])
def test_a_folder_that_is_no_run_is_one_line(tis: Call, command: tuple[str, ...]) -> None:
    Path("e").mkdir()
    code, _, err = tis(*command)
    assert code == 4
    assert "e: is no run folder" in _one_line(err)
    assert not list(Path("e").iterdir())


def test_export_writes_all_or_nothing(tis: Call, run: Path) -> None:
    code, out, _ = tis("export", "r", "--csv", "--jigsaws")
    assert code == 0
    names = {str(path.relative_to(run / "export")) for path in (run / "export").rglob("*.*")}
    assert {"tracks.csv", "messages.csv", "Suturing/kinematics/AllGestures/Suturing_R001.txt"} <= names
    assert all(name in out for name in names)
    code, _, err = tis("export", "r", "--csv")
    assert code == 4
    assert "r/export: must be a new or an empty folder" in _one_line(err)
    code, _, err = tis("export", "r")
    assert code == 2
    assert "--csv, --parquet or --jigsaws: at least one is required" in _one_line(err)
    assert not list(run.glob(".export-*"))


def test_jigsaws_rows_are_30_a_second(tis: Call) -> None:
    tis("twin", "default", "--duration-s", "3", "--set", "rate_hz=60", "--run-dir", "f", "--no-report", "--no-merge")
    assert not Path("f/run.mcap").exists()
    code, _, err = tis("export", "f", "--jigsaws")
    assert code == 2
    assert "--jigsaws: needs a run at 30 Hz (got 60)" in _one_line(err)
    assert not Path("f/export").exists()
