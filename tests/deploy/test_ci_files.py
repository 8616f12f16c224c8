"""The GitHub Action and netem's image: no runner and no container engine is here, so their commands are read and run.

In new environments, with all that they install, `python -m tests.deploy.fresh_environment` runs them.
"""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from tests.deploy.fresh_environment import ACTION, ROOT, action_steps, run_step, stages
from tests.docs.test_bad_network_pages import blocks
from tis.common.runtime.ports import free_endpoints

_WITHOUT = """\
import sys
for name in sys.argv[1].split(","):
    sys.modules[name] = None  # importing it fails
from tis.deploy.cli.main import main
sys.argv = ["tis", *sys.argv[2:]]
main()
"""
_MODULES = {"pillow": "PIL", "fonttools": "fontTools", "python-dateutil": "dateutil"}


@pytest.fixture
def runner(tmp_path: Path) -> Path:
    """Return the runner's temporary folder, in which the first step has installed this checkout."""
    command = tmp_path / "tis" / "bin" / "tis"
    command.parent.mkdir(parents=True)
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m tis.deploy.cli.main "$@"\n')
    command.chmod(0o755)
    return tmp_path


def the_action(runner: Path, **inputs: str) -> "subprocess.CompletedProcess[str]":
    west, east = free_endpoints()
    script, env = action_steps(west=west, east=east, **inputs)[1]
    return run_step(script, env | {"PYTHONPATH": str(ROOT), "PYTHONSAFEPATH": "1"}, runner)


@pytest.mark.live
def test_the_action_runs_the_commands_behind_a_bad_network_and_prints_the_table(runner: Path) -> None:
    (runner / "net.yaml").write_text("forward: {delay: {kind: constant, delay_ms: 5}}\n")
    show = "tis net show -e $TIS_EAST\nfalse\necho not reached"
    done = the_action(runner, run=show, network="net.yaml", keys="demo/** other/*", options="--seed 3")
    assert done.returncode == 1, (
        done.stdout + done.stderr
    )  # that of the commands, which end with the first that fails
    assert re.search(r"^delay +constant delay_ms 5 ", done.stdout, re.MULTILINE)
    assert "crossing: demo/**, other/*" in done.stdout
    assert re.search(r"^ *forward \(west to east\) +0 +0", done.stdout, re.MULTILINE)
    assert "not reached" not in done.stdout


@pytest.mark.parametrize(("profile", "code"), [("wifi_sad", 1), ("wifi_bad", 0)])
def test_the_lines_for_any_ci_end_also_where_netem_does_not_start(runner: Path, profile: str, code: int) -> None:
    lines = blocks("in_ci.md", "sh")[0]
    for port, free in zip(("7447", "7448"), free_endpoints(), strict=True):
        lines = lines.replace(f"tcp/127.0.0.1:{port}", free)
    lines = lines.replace("uvx --from git+ADDRESS tis", str(runner / "tis" / "bin" / "tis"))
    script = lines.replace("wifi_bad", profile) + "kill $netem; wait $netem || true; echo ended"
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONSAFEPATH": "1"}
    done = subprocess.run(
        ["bash", "-c", script], cwd=runner, env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == code, done.stdout + done.stderr
    assert ("wifi_sad" in done.stdout) == (code == 1)
    assert done.stdout.endswith("ended\n") == (code == 0)


def test_the_action_says_why_there_is_no_network(runner: Path) -> None:
    done = the_action(runner, run="echo not reached", profile="wifi_sad")
    assert done.returncode == 1
    assert "wifi_sad" in done.stdout
    assert "not reached" not in done.stdout


def test_the_action_puts_no_input_into_its_scripts() -> None:
    """What stands in a script is executed: inputs come as variables."""
    action = yaml.safe_load(ACTION.read_text(encoding="utf-8"))
    assert not any("${{" in step["run"] for step in action["runs"]["steps"])
    assert all("upload" not in str(step) for step in action["runs"]["steps"])


def test_the_page_gives_the_action_what_it_takes() -> None:
    inputs = yaml.safe_load(ACTION.read_text(encoding="utf-8"))["inputs"]
    for workflow in blocks("in_ci.md", "yaml"):
        (job,) = yaml.safe_load(workflow)["jobs"].values()
        assert "runs-on" in job
        assert {"run": "pip install eclipse-zenoh"} in job["steps"]
        (step,) = (step for step in job["steps"] if "/deploy/action@" in step.get("uses", ""))
        assert step["with"].keys() <= inputs.keys()


def test_the_page_s_commands_fail_as_the_one_in_the_background_does() -> None:
    (workflow,) = blocks("in_ci.md", "yaml")
    (job,) = yaml.safe_load(workflow)["jobs"].values()
    python = 'python() { [ "$2" != subscribe ]; }\n'
    words = ["bash", "-eo", "pipefail", "-c", python + job["steps"][-1]["with"]["run"]]
    assert subprocess.run(words, check=False).returncode == 1


@pytest.mark.live
def test_netem_needs_nothing_of_what_its_image_leaves_out(tmp_path: Path) -> None:
    (build,) = stages()["build-netem"]
    left_out = build.partition("uninstall --yes")[2].split()
    modules = ",".join(_MODULES.get(name, name) for name in left_out)
    west, east = free_endpoints()
    words = [
        "netem",
        "--west",
        west,
        "--east",
        east,
        "--profile",
        "lte_handover",
        "--duration-s",
        "0.2",
        "--summarize",
    ]
    done = subprocess.run(
        [sys.executable, "-c", _WITHOUT, modules, *words], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert list(tmp_path.glob("runs/*/summary.json"))
    netem = stages()["netem"]
    assert "USER tis" in netem
    assert 'ENTRYPOINT ["tis", "netem"]' in netem
