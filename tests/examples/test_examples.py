"""Every file of examples/ runs as its tutorial shows it; counts and exit codes are judged, not times."""

import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.deploy.commands import call
from tests.system.conftest import is_right_but_for_the_machine, model_file
from tis.common.runtime.ports import free_ports
from tis.common.scenario.reading import dump_scenario
from tis.deploy.report import load
from tis.deploy.run.resolve import resolve

__all__ = ["model_file"]

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
TUTORIALS = ROOT / "docs" / "tutorials"
_MODULE, _, _FUNCTION = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["scripts"]["tis"].partition(
    ":"
)
_MAIN = f"from {_MODULE} import {_FUNCTION}; {_FUNCTION}()"
COMMANDS = {"tis": f'-c "{_MAIN}"', "python": ""}


@pytest.fixture
def there(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a new current folder with examples/ in it; `tis` and `python` are those of this test."""
    commands = tmp_path / "bin"
    commands.mkdir()
    for name, words in COMMANDS.items():
        _write_command(commands / name, words)
    shutil.copytree(EXAMPLES, tmp_path / "examples", ignore=shutil.ignore_patterns("runs", "__pycache__"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{commands}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    monkeypatch.setenv("COLUMNS", "200")
    return tmp_path


def _write_command(path: Path, words: str) -> None:
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
    path.chmod(0o755)


@pytest.fixture
def no_report(there: Path) -> None:
    """Let `tis` take Bokeh for missing: for tests that do not look at the report, which takes longest."""
    missing = "from tis.deploy.shell import guard; guard.can_report = lambda: False"
    _write_command(there / "bin" / "tis", f'-c "{missing}; {_MAIN}"')


@pytest.fixture
def no_identification(there: Path, model_file: Path) -> None:
    """Let each `tis run` and `tis twin` read its model from a file: for tests that do not look at how it is found."""
    words = ["--set", f"identification.train={model_file}"]
    given = f"import sys; sys.argv += {words} if sys.argv[1] in ('run', 'twin') else []"
    _write_command(there / "bin" / "tis", f'-c "{given}; {_MAIN}"')


@pytest.fixture
def few_estimators(there: Path) -> None:
    """Let the recording be played with two estimators: the others take longest, and nothing here looks at them."""
    with (there / "examples" / "own_recording.yaml").open("a") as file:
        file.write("estimators: [hold, innovations_kf]\n")


def example(*words: str, **more: Any) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(list(words), capture_output=True, text=True, timeout=300, check=False, **more)


def summary(run_dir: str) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((Path(run_dir) / "summary.json").read_text())
    return content


def test_every_example_is_in_a_tutorial_and_every_tutorial_has_one() -> None:
    index = (TUTORIALS / "index.md").read_text(encoding="utf-8")
    listed = {word.removeprefix("examples/") for word in re.findall(r"`((?:examples/)?\w+\.(?:sh|py|yaml))`", index)}
    there = {path.name for path in EXAMPLES.iterdir() if path.suffix in {".sh", ".py", ".yaml"}}
    assert listed == there
    for page in TUTORIALS.glob("*.md"):
        assert "examples" in page.read_text(encoding="utf-8") or page.name == "first_run.md"


def test_an_own_recording_is_identified_and_played(there: Path, few_estimators: None) -> None:
    done = example("examples/own_recordings.sh", "o")
    assert done.returncode == 0, done.stderr
    assert "1000 rows, taken at 50 Hz, are 20.0 s" in done.stdout
    assert "MTML -> PSM2 (by the table" in " ".join(done.stdout.split())
    found = summary("o/twin")
    assert found["valid"]
    assert found["source"] == "table own_recording, left hand"
    assert found["duration_s"] == 19.98  # 2000 rows, 1000 to train on, and the last for truth after the last sample


def test_an_own_estimator_runs_beside_the_others(there: Path, no_identification: None) -> None:
    done = example("examples/own_estimator.sh", "o", "4", "")  # the comparison: tests/deploy/compare
    assert done.returncode == 0, done.stderr
    assert set(summary("o/twin")["accuracy"]) == {"hold", "innovations_kf", "my_filter:AlphaBeta"}


@pytest.mark.slow
def test_figures_for_a_paper_are_drawn(there: Path, model_file: Path) -> None:
    Path("s.yaml").write_text(dump_scenario(resolve("default", (f"identification.train={model_file}",), None, 4.0)))
    done = example("examples/paper_figure.sh", "o", "4", "s.yaml")
    assert done.returncode == 0, done.stderr
    n_scored = int(np.count_nonzero(load("o/twin").tracks["left"].scored))
    printed = dict(re.findall(r"^(\w+) +(\d+) ticks, median", done.stdout, re.MULTILINE))
    assert printed.keys() == {"hold", "damped_velocity", "moesp_kf", "innovations_kf"}
    assert {int(count) for count in printed.values()} == {n_scored}
    assert Path("o/error.pdf").read_bytes().startswith(b"%PDF")
    assert len(list(Path("o/figures").glob("*.pdf"))) == 7


@pytest.mark.live
def test_the_first_run_has_a_twin_and_a_replay(there: Path, no_identification: None) -> None:
    done = example("examples/first_run.sh", "o", "3", "--no-report", "--no-merge")
    if is_right_but_for_the_machine(done.returncode, summary("o/live")) and done.returncode:
        pytest.skip("the machine was too busy for a live run, which ended the script")
    assert done.returncode == 0, done.stderr
    assert re.search(r"fates compared with o/live: 0 differ", done.stdout)
    assert "identical, bit for bit" in done.stdout


@pytest.mark.slow
@pytest.mark.live
def test_three_hosts_make_one_run(there: Path, model_file: Path, no_report: None) -> None:
    west, east = free_ports(2)
    scenario = Path("examples/three_hosts.yaml").read_text()
    for shown, here in (("7451", str(west)), ("7452", str(east)), ("duration_s: 10", "duration_s: 3")):
        assert shown in scenario
        scenario = scenario.replace(shown, here)
    scenario += f"identification: {{train: {model_file}}}\n"
    Path("s.yaml").write_text(f"{scenario}estimators: [hold, damped_velocity]\nactive_estimator: damped_velocity\n")
    done = example("examples/three_hosts.sh", "o", "s.yaml")
    found = summary("o/gathered")
    assert is_right_but_for_the_machine(done.returncode, found), done.stderr
    assert found["links"]["forward"]["sent"] <= 180
    assert abs(found["clocks"]["patient"]["offset_ms"]) > 2000  # as TIS_CLOCK_SKEW has it


@pytest.mark.slow
@pytest.mark.live
def test_tis_up_makes_one_run_of_the_three_hosts(there: Path, model_file: Path) -> None:
    west, east = free_ports(2)
    scenario = Path("examples/three_hosts.yaml").read_text()
    for shown, here in (("7451", str(west)), ("7452", str(east)), ("duration_s: 10", "duration_s: 3")):
        assert shown in scenario
        scenario = scenario.replace(shown, here)
    scenario += f"identification: {{train: {model_file}}}\n"
    Path("examples/three_hosts.yaml").write_text(f"{scenario}estimators: [hold]\nactive_estimator: hold\n")
    code, _, err = call("up", "examples/hosts.yaml", "--run-dir", "o", "--no-report", "--no-merge")
    found = summary("o")
    assert is_right_but_for_the_machine(code, found), err
    assert abs(found["clocks"]["patient"]["offset_ms"]) > 2000
    assert {path.name for path in Path("o").glob("*.mcap")} == {"surgeon.mcap", "netem.mcap", "patient.mcap"}


@pytest.mark.live
def test_a_bad_network_lies_between_two_programs(there: Path) -> None:
    west, east = (f"tcp/127.0.0.1:{port}" for port in free_ports(2))
    words = ["tis", "netem", "--west", west, "--east", east, "--set", "forward.delay.delay_ms=50", "--set",
             "forward.loss={kind: burst, p_loss: 0.05, mean_burst: 3}", "--run-dir", "o", "demo/**"]  # fmt: skip
    program = ["python", "examples/bad_network.py"]
    with ExitStack() as stack:
        netem = stack.enter_context(subprocess.Popen(words, stderr=subprocess.PIPE, text=True))
        stack.callback(netem.kill)
        assert netem.stderr is not None
        assert any(line.startswith("netem: running") for line in netem.stderr)
        subscriber = stack.enter_context(
            subprocess.Popen([*program, "subscribe", "-e", east], stdout=subprocess.PIPE, text=True)
        )
        stack.callback(subscriber.kill)
        assert subscriber.stdout is not None
        assert subscriber.stdout.readline() == "subscribed\n"
        published = example(*program, "publish", "-e", west, "--rate-hz", "400")
        assert published.stdout == "published 500\n", published.stderr
        printed = subscriber.communicate(timeout=120)[0]
        netem.terminate()
        assert netem.wait(timeout=120) == 0
    # Decided by the seed alone: the tutorial shows the same numbers.
    assert "received 451 messages, 49 of the first 500 did not arrive" in printed
    assert "received 451 messages, 49 of the first 500" in (TUTORIALS / "bad_network.md").read_text(encoding="utf-8")


def _joined(
    model_file: Path, *settings: str, programs: dict[str, list[str]]
) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the summary of a run over bad Wi-Fi in which these programs took part, and what each of them printed."""
    west, east = (f"tcp/127.0.0.1:{port}" for port in free_ports(2))
    ends = {"WEST": west, "EAST": east}
    command = ["run", "live", "--run-dir", "j", "--duration-s", "5", "--no-report", "--no-merge", *settings]
    command += ["--set", "estimators=[hold, innovations_kf]", "--set", f"identification.train={model_file}"]
    command += ["--set", f"hosts={{west: {west}, east: {east}}}"]
    joined = {
        name: subprocess.Popen(
            [sys.executable, "-W", "error", f"examples/{name}", *(ends.get(word, word) for word in words)],
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        )
        for name, words in programs.items()
    }  # fmt: skip
    printed = {}
    try:
        code, _, told = call(*command)
        for name, program in joined.items():
            printed[name], _ = program.communicate(timeout=60)
            assert program.returncode == 0, printed[name]
    finally:
        for program in joined.values():
            program.kill()
    found = summary("j")
    assert is_right_but_for_the_machine(code, found), told
    return found, printed


@pytest.mark.slow
@pytest.mark.live
def test_a_device_and_an_arm_of_others_join_a_run(there: Path, model_file: Path) -> None:
    programs = {"device.py": ["WEST"], "foreign_arm.py": ["EAST"]}
    found, printed = _joined(model_file, "--set", "patient.plant.kind=external", programs=programs)
    assert "poses sent" in printed["device.py"]
    device, arm = found["devices"]["left"], found["external_arms"]["left"]
    assert device["poses"] > 100
    assert set(device["refused"].values()) == set(arm["refused"].values()) == {0}
    assert arm["poses"] > 100
    assert found["source"] == "live device, left hand"
    assert found["accuracy"]["plant"]["n_scored"] > 30
    assert found["accuracy"]["innovations_kf"]["rmse_3d_mm"] < 20
    assert found["latency_ms"]["actuation"]["p50"] > 0


@pytest.mark.slow
@pytest.mark.live
def test_a_surgeon_that_is_no_part_of_the_testbed_replaces_ours(there: Path, model_file: Path) -> None:
    found, printed = _joined(model_file, "--foreign-surgeon", programs={"foreign_surgeon.py": ["WEST"]})
    assert re.fullmatch(rf"150 samples sent in run {found['run_id']}\n", printed["foreign_surgeon.py"])
    assert found["source"] == "foreign surgeon, left hand"
    assert found["surgeon_ticks"]["count"] == 150
    assert found["links"]["forward"]["sent"] == 2 * (150 - found["surgeon_ticks"]["missed"])
    assert found["accuracy"]["innovations_kf"]["n_scored"] > 30
    assert set(found["quarantined"].values()) == {0}
    assert found["rejected"] == {"surgeon": 0, "patient": 0}
