"""What programs ask for: JSON on standard output, and silence."""

import json
from pathlib import Path

import pytest

from tests.deploy.commands import call


@pytest.fixture(scope="module")
def run_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of a quiet twin, which says nothing."""
    path = tmp_path_factory.mktemp("twin") / "r"
    words = ("twin", "default", "--duration-s", "2", "--run-dir", str(path), "--no-report", "--no-merge")
    code, out, err = call(*words, "-q")
    assert code in (0, 5)
    assert (out, err) == ("", "")
    return path


def test_quiet_keeps_warnings_errors_and_json(run_dir: Path, tmp_path: Path) -> None:
    code, out, err = call("twin", "default", "--run-dir", str(run_dir), "-q")
    assert (code, out) == (4, "")
    assert "must be new or empty" in " ".join(err.split())
    own = ("--run-dir", str(tmp_path / "r"), "--no-report", "--no-merge")
    code, out, _ = call("twin", "default", "--duration-s", "2", *own, "-q", "--json")
    assert json.loads(out)["scenario"] == "default"


def test_a_scenario_a_replay_and_a_report_are_json(run_dir: Path) -> None:
    code, out, _ = call("validate", "default", "--set", "seed=5", "--json")
    assert code == 0
    assert json.loads(out)["seed"] == 5
    code, out, err = call("replay", str(run_dir), "--json")
    assert code == 0
    assert json.loads(out)["identical"]
    assert "identical, bit for bit" in " ".join(err.split())
    pytest.importorskip("bokeh")
    code, out, _ = call("report", str(run_dir), "--json")
    assert json.loads(out) == {"files": [str(run_dir / "report.html")], "complete": True}
