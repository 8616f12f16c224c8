"""`tis report`, and the report at the end of a run: what a person reads when there is one, and when there is none."""

import importlib.util
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from importlib.machinery import ModuleSpec
from pathlib import Path

import pytest

from tests.deploy.commands import call_by_lines as tis
from tests.deploy.hold_only import HOLD
from tis.common.extras import GET_REPORT
from tis.deploy.shell import run_dir as folder

_TWIN = ("twin", "default", "--duration-s", "3", *(f"--set={setting}" for setting in HOLD), "--no-merge")


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A twin of 3 s without a report."""
    path = tmp_path_factory.mktemp("finished") / "a run"
    code, out, _ = tis(*_TWIN, "--run-dir", str(path), "--no-report")
    assert code == 0
    assert out[-1] == f"The run lies in {path}; all tables: tis info -v '{path}'"
    assert not (path / "report.html").exists()
    return path


@pytest.fixture
def run_dir(finished: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(finished, tmp_path / "run"))


@pytest.fixture
def without_bokeh(monkeypatch: pytest.MonkeyPatch) -> None:
    found: Callable[..., ModuleSpec | None] = importlib.util.find_spec
    monkeypatch.setattr("tis.deploy.shell.guard.find_spec", lambda name: None if name == "bokeh" else found(name))


def test_the_last_line_of_a_run_names_its_report(tmp_path: Path) -> None:
    path = tmp_path / "run"
    code, out, _ = tis(*_TWIN, "--run-dir", str(path))
    assert code == 0
    assert out[-1] == f"Report: {path / 'report.html'}"
    manifest = folder.read_json(path / "manifest.json")
    assert manifest is not None
    page = (path / "report.html").read_text()
    assert manifest["versions"]["mcap"] in page
    assert "report.html" not in manifest["sha256"]  # it may be written again


def test_a_report_can_be_written_afterwards_and_again(run_dir: Path) -> None:
    for _ in range(2):
        assert tis("report", str(run_dir)) == (0, [f"Report: {run_dir / 'report.html'}"], [])
    assert "valid measurement" in (run_dir / "report.html").read_text()


def test_a_killed_run_has_a_report_without_a_summary(run_dir: Path) -> None:
    for name in ("summary.json", "manifest.json", "model.json", "netem.mcap"):
        (run_dir / name).unlink()
    patient = (run_dir / "patient.mcap").read_bytes()
    (run_dir / "patient.mcap").write_bytes(patient[: len(patient) // 2])
    assert tis("report", str(run_dir))[0] == 3
    page = (run_dir / "report.html").read_text()
    for words in (
        "not a valid measurement",
        "netem: log is missing",
        "patient: log is damaged",
        "Position over time",
    ):
        assert words in page
    assert not (run_dir / "summary.json").exists()


def test_a_summary_that_is_older_than_a_log_s_damage_is_not_believed(run_dir: Path) -> None:
    assert json.loads((run_dir / "summary.json").read_text())["valid"]
    patient = (run_dir / "patient.mcap").read_bytes()
    (run_dir / "patient.mcap").write_bytes(patient[: len(patient) // 2])
    code, out, _ = tis("report", str(run_dir))
    assert code == 3
    assert any("patient: log is damaged" in line for line in out)
    assert "not a valid measurement" in (run_dir / "report.html").read_text()


def test_a_folder_without_any_log_has_nothing_to_report(run_dir: Path) -> None:
    for path in run_dir.glob("*.mcap"):
        path.unlink()
    code, _, err = tis("report", str(run_dir))
    assert code == 4
    assert "holds no log" in err[0]
    assert not (run_dir / "report.html").exists()


def test_without_bokeh_a_run_says_how_to_get_a_report(tmp_path: Path, without_bokeh: None) -> None:
    path = tmp_path / "run"
    code, out, _ = tis(*_TWIN, "--run-dir", str(path))
    assert code == 0
    assert out[-1] == f"No report was written, since Bokeh is not installed: {GET_REPORT}"
    assert not (path / "report.html").exists()
    assert (path / "summary.json").exists()


def test_without_bokeh_the_command_is_refused_in_one_line(run_dir: Path, without_bokeh: None) -> None:
    code, out, err = tis("report", str(run_dir))
    assert (code, out) == (2, [])
    assert err == [f"tis: tis report: needs Bokeh: {GET_REPORT}"]


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("scenario.yaml", "a: [", "scenario.yaml"),
        ("summary.json", "{", "is not readable JSON"),
        ("summary.json", '{"seed": 1}', "is no summary of this version"),
    ],
)
def test_a_folder_that_cannot_be_read_is_one_line(run_dir: Path, name: str, content: str, words: str) -> None:
    (run_dir / name).write_text(content)
    code, out, err = tis("report", str(run_dir))
    assert code in (2, 4)
    assert out == []
    assert len(err) == 1
    assert words in err[0]
    assert not (run_dir / "report.html").exists()


def test_a_folder_that_is_no_run_is_one_line(tmp_path: Path) -> None:
    code, _, err = tis("report", str(tmp_path))
    assert code == 4
    assert len(err) == 1
    assert "is no run folder" in err[0]


def test_a_run_without_a_report_loads_nothing_that_draws() -> None:
    modules = (
        "tis.deploy.run.conclude, tis.deploy.tools.info, tis.deploy.standalone.command, tis.deploy.report.contents"
    )
    code = f"import sys, {modules}; print({{'bokeh', 'jinja2', 'matplotlib'}} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "set()"
