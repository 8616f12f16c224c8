"""``tis info``, ``merge``, ``recover``, ``export`` on good and bad inputs: one line each, the right exit code."""

from collections.abc import Callable
from pathlib import Path
from shutil import copytree

import pytest

from tests.deploy.commands import Call, call
from tests.deploy.hold_only import HOLD
from tests.deploy.logs.conftest import run_dir, scenario, write_ros2
from tests.log_reader import cut
from tis.deploy.shell.guard import ERR, OUT

__all__ = ["run_dir", "scenario"]


@pytest.fixture
def tis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return a function that calls `tis` in an empty folder: exit code, output, diagnostics."""
    monkeypatch.chdir(tmp_path)
    for console in (OUT, ERR):  # whatever the terminal of the tests was when they were made
        monkeypatch.setattr(console, "_width", 150)

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
    for command in (("export", "r", "--csv"), ("summarize", "r"), ("report", "r")):
        code, out, err = tis(*command)
        assert (code, out) == (4, "")
        assert "r/netem.mcap: is no log of tis, but of" in _one_line(err)
    assert not (run / "export").exists()


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
    assert code == 4
    assert "/patient/tis/ticks" in out
    assert "is damaged: the file ends early" in _one_line(err)
    assert "see tis recover" in err


def test_recover_says_what_was_lost(tis: Call, run: Path) -> None:
    code, out, err = tis("recover", "r/patient.mcap")
    assert (code, err) == (0, "")
    assert "r/patient.mcap: is intact, " in out
    assert "nothing to recover, no file was written" in out
    assert not list(run.glob("*_recovered*"))
    assert "recovered" not in tis("info", "r")[1]
    log = run / "netem.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    code, _, err = tis("recover", "r/netem.mcap")
    assert code == 3
    assert "was damaged: the file ends early" in _one_line(err)
    code, _, err = tis("recover", "r/netem.mcap")
    assert code == 4
    assert "exists already" in _one_line(err)


def test_merge_of_a_run_without_netem_s_log_is_said_to_be_in_part(tis: Call, run: Path, without_report: None) -> None:
    (run / "netem.mcap").unlink()
    code, out, err = tis("merge", "r")
    assert code == 3
    assert "Merged: r/run.mcap" in out
    assert "r: netem.mcap is missing or empty; the rest was merged" in _one_line(err)
    code, out, err = tis("info", "r")
    assert code == 4
    assert _one_line(err) == "tis: r: netem.mcap is missing"
    assert out.startswith("summary.json is older than this damage")
    assert "Before netem.mcap was lost this run was a valid measurement." in out
    assert "This run is a valid" not in out
    assert tis("summarize", "r")[0] == 5
    code, out, _ = tis("info", "r")
    assert (code, "older" in out, "  netem: log is missing" in out) == (4, False, True)


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
    code, _, err = tis("export", "r", "--parquet")
    assert code == 2
    assert "r/export: must be a new or an empty folder: give --csv, --parquet and --jigsaws at once, or" in err
    _one_line(err)
    code, _, err = tis("export", "r")
    assert code == 2
    assert "--csv, --parquet or --jigsaws: at least one is required" in _one_line(err)
    assert not list(run.glob(".export-*"))


def test_jigsaws_rows_are_30_a_second(tis: Call) -> None:
    settings = ("rate_hz=60", *HOLD, "identification.train_samples=300")
    words = (*(f"--set={setting}" for setting in settings), "--run-dir", "f", "--no-report", "--no-merge")
    assert tis("twin", "default", "--duration-s", "3", *words)[0] == 0
    assert not Path("f/run.mcap").exists()
    code, _, err = tis("export", "f", "--jigsaws")
    assert code == 2
    assert "--jigsaws: needs a run at 30 Hz (got 60)" in _one_line(err)
    assert not Path("f/export").exists()


def test_info_of_a_run_with_a_damaged_log_begins_with_it(tis: Call, run: Path, without_report: None) -> None:
    cut(run / "patient.mcap")
    code, out, err = tis("info", "r")
    assert code == 4
    assert "r/patient.mcap: is damaged: the file ends early" in _one_line(err)
    assert "see tis recover" in err
    assert out.startswith("summary.json is older than this damage")
    assert "Before patient.mcap was damaged this run was a valid measurement." in out
    assert tis("summarize", "r")[0] == 5
    code, out, _ = tis("info", "r")
    assert code == 4
    assert "older" not in out
    assert "patient: log is damaged (the file ends early" in " ".join(out.split())


def test_what_was_recovered_is_read_from_then_on_and_says_what_it_lacks(
    tis: Call, run: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cut(run / "patient.mcap")
    code, out, _ = tis("recover", "r/patient.mcap")
    assert code == 3
    assert "It now replaces patient.mcap; tis summarize r computes the summary again" in out
    code, out, err = tis("info", "r/patient_recovered.mcap")
    assert (code, err) == (0, "")
    assert out.startswith("patient_recovered.mcap was recovered from a damaged log; nothing is known after ")
    assert "metadata recovered: of patient.mcap" in out
    for command, expected in ((("summarize", "r"), 5), (("report", "r"), 3), (("export", "r", "--csv"), 3)):
        with monkeypatch.context() as patch:
            if command[0] == "summarize":  # its report is the next command's
                patch.setattr("tis.deploy.report.command.can_report", lambda: False)
            code, out, err = tis(*command)
        assert code == expected
        assert "patient: log was recovered from a damaged one (patient_recovered.mcap)" in " ".join(
            (out + err).split()
        )
    assert "log was recovered from a damaged one" in (run / "export" / "README.md").read_text()
    code, _, err = tis("merge", "r")
    assert code == 3
    assert "patient_recovered.mcap was recovered from a damaged log" in err
    code, out, err = tis("info", "r")
    assert code == 4
    assert "patient_recovered.mcap replaces it" in _one_line(err)
    assert "recovered: nothing is known after" in out


def test_a_log_whose_index_alone_is_torn_loses_nothing(tis: Call, run: Path, without_report: None) -> None:
    log = run / "surgeon.mcap"
    log.write_bytes(log.read_bytes()[:-60])
    code, out, err = tis("recover", "r/surgeon.mcap")
    assert (code, err) == (0, "")
    assert "only in the index at its end, no message is lost" in out
    assert tis("summarize", "r")[0] == 0


@pytest.mark.parametrize("make", [lambda path: path.write_text("dear diary\n"), lambda path: path.mkdir()])
def test_what_is_no_log_at_all_is_said_before_anything_is_written(
    tis: Call, run: Path, make: Callable[[Path], object]
) -> None:
    (run / "patient.mcap").unlink()
    make(run / "patient.mcap")
    before = {path.name: path.stat().st_mtime_ns for path in run.iterdir()}
    for command in (("summarize", "r"), ("merge", "r"), ("report", "r"), ("export", "r", "--csv")):
        code, out, err = tis(*command)
        assert (code, out) == (4, "")
        assert _one_line(err).startswith("tis: r/patient.mcap: ")
    assert {path.name: path.stat().st_mtime_ns for path in run.iterdir()} == before
    code, out, err = tis("info", "r")
    assert code == 4
    assert _one_line(err).startswith("tis: r/patient.mcap: ")
    assert "no log: " in out


def test_a_recovered_log_of_another_tool_is_not_read_and_that_is_said(
    tis: Call, run: Path, without_report: None
) -> None:
    (run / "patient_recovered.mcap").write_bytes((run / "patient.mcap").read_bytes())
    code, out, err = tis("info", "r")
    assert (code, err) == (0, "")
    assert "not read: not marked as recovered" in " ".join(out.split())
    assert tis("summarize", "r")[0] == 0


def test_an_export_explains_itself(tis: Call, run: Path) -> None:
    assert tis("export", "r", "--csv")[0] == 0
    text = (run / "export" / "README.md").read_text()
    assert "## tracks.csv" in text
    assert "| `moesp_kf_error_mm` | mm | distance of moesp_kf's estimate from the truth; empty: no estimate |" in text
    assert "JIGSAWS" not in text
    assert tis("export", "r", "--jigsaws", "-o", "j")[0] == 0
    text = Path("j/README.md").read_text()
    assert "`R001` has the surgeon's messages" in text
    assert ".csv" not in text


def test_a_summary_of_an_older_version_is_one_line_beside_the_logs(tis: Call, run: Path) -> None:
    for content in ('{"problems": [], "links": {}}', "[]"):
        (run / "summary.json").write_text(content)
        code, out, err = tis("info", "r")
        assert code == 4
        assert "r/summary.json: " in _one_line(err)
        assert ("patient.mcap" in out) == (content != "[]")
    assert "must be a JSON object" in err


def test_what_was_recovered_of_another_log_is_not_read_and_that_is_said(tis: Call, run: Path) -> None:
    whole = (run / "patient.mcap").read_bytes()
    cut(run / "patient.mcap")
    assert tis("recover", "r/patient.mcap")[0] == 3
    (run / "patient.mcap").write_bytes(whole)
    code, out, err = tis("info", "r")
    assert (code, err) == (0, "")
    assert "not read: not recovered from this patient.mcap" in " ".join(out.split())


def test_a_missing_log_does_not_hide_that_the_others_do_not_belong_together(tis: Call, run: Path) -> None:
    hold = [f"--set={setting}" for setting in HOLD]
    words = ("--duration-s", "4", "--seed", "9", *hold, "--run-dir", "other", "--no-report", "--no-merge")
    assert tis("twin", "default", *words)[0] == 0
    (run / "patient.mcap").write_bytes(Path("other/patient.mcap").read_bytes())
    (run / "netem.mcap").unlink()
    code, _, err = tis("info", "r")
    assert code == 4
    assert err.startswith("tis: r: netem.mcap is missing")
    assert len(err.strip().splitlines()) == 2
