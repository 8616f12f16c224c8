"""Lives of the sides in live runs: what stands still, cannot be reached, or has a clock that steps is named."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.deploy.commands import call, call_in_one_line
from tests.system.conftest import Start
from tests.system.hosts import IP, Hosts, hosts
from tis.common.runtime.ports import free_endpoints
from tis.deploy.tools.certificates import issue, new_authority

pytestmark = pytest.mark.live
__all__ = ["hosts"]
_TIS = [sys.executable, "-m", "tis.deploy.cli.main"]
_SLOW = """
import time
from pathlib import Path
import numpy as np
from tis.patient_side.estimators.protocol import Estimate

NOW = Path(__file__).with_name("now")

class Slow:
    name = "slow"
    def initial(self):
        return False
    def step(self, state, playout, now_ns):
        if not state and NOW.exists():
            time.sleep(3.0)
            state = True
        return state, Estimate(np.zeros(3), None)

def factory(model):
    return Slow()
"""
_SCENARIO = """\
version: 1
name: peers
duration_s: DURATION
source: {kind: synthetic}
hosts: {west: WEST, east: EAST}
network: {forward: {delay: {kind: constant, delay_ms: 20}}}
estimators: [hold]
active_estimator: hold
"""


def test_a_side_that_stands_still_or_blocks_is_told_and_is_not_dead(
    start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """First the patient stands still, then netem, then the patient's estimator; each is back before the next."""
    (tmp_path / "slow_filter.py").write_text(_SLOW)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    names = ("--set", "estimators=[hold, 'slow_filter:factory']", "--set", "active_estimator=slow_filter:factory")
    tis = start("run", "default", "--duration-s", "17", *names)
    tis.await_log("surgeon")
    for module in ("tis.patient_side", "tis.netem"):
        victim = tis.child(module)
        os.kill(victim, signal.SIGSTOP)
        time.sleep(3)
        os.kill(victim, signal.SIGCONT)
        time.sleep(2)
    (tmp_path / "now").touch()
    code, _, err = tis.wait()
    assert code == 5, err
    all_problems = tis.summary()["problems"]
    problems = [text for text in all_problems if " at " in text and "noticed" in text]
    for side in ("patient", "netem"):
        assert f"surgeon: warning: {side} stands still" in err
        assert f"surgeon: warning: {side} is back after" in err
        assert f"{side}: warning: this process stood still for" in err
        assert len([text for text in problems if text.startswith(f"{side} stood still (")]) == 1, problems
    others = [text for text in problems if " stood still (" not in text]
    assert (len(problems) - len(others), len(others) <= 1) == (2, True), problems
    assert all("its loop stayed in one step (slow_filter:factory)" in text for text in others), problems
    assert "patient does not tick: its loop has been in one step for" in " ".join(err.split())
    assert "slow_filter:factory" in err
    assert any("its loop stayed in one step (slow_filter:factory)" in text for text in all_problems)
    assert "clock" not in err


def _sides(
    stack: ExitStack, folder: Path, prefix: dict[str, list[str]], environment: dict[str, dict[str, str]]
) -> dict[str, subprocess.Popen[str]]:
    """Start the three sides in one folder each, with what comes before each one's command."""
    found = {}
    for side in ("netem", "surgeon", "patient"):
        (folder / side).mkdir(exist_ok=True)
        words = [
            *prefix[side],
            *_TIS,
            side,
            str(folder / "s.yaml"),
            "--run-dir",
            str(folder / "run"),
            "--wait-s",
            "60",
        ]
        process = subprocess.Popen(
            words, cwd=folder / side, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=os.environ | environment.get(side, {}),
        )  # fmt: skip
        found[side] = stack.enter_context(process)
        stack.callback(process.kill)
    return found


def _await_word(process: subprocess.Popen[str], word: str) -> None:
    """Read what a side says until it has said this."""
    assert process.stderr is not None
    said = ""
    for line in process.stderr:
        said = f"{said} {line.strip()}"
        if word in said:
            return
    raise AssertionError(said)


@pytest.mark.slow
def test_a_clock_that_steps_is_named_and_a_side_silent_for_too_long_ends_the_run(
    tmp_path: Path, without_report: None
) -> None:
    """The patient's clock steps; once it has said so, it stands still until the others are gone."""
    west, east = free_endpoints()
    text = _SCENARIO.replace("WEST", west).replace("EAST", east).replace("DURATION", "60")
    (tmp_path / "s.yaml").write_text(f"{text}on_peer_loss: end\npeer_timeout_s: 5\n")
    with ExitStack() as stack:
        skew = {"patient": {"TIS_CLOCK_SKEW": "0:0:10@12"}}
        processes = _sides(stack, tmp_path, {side: [] for side in ("netem", "surgeon", "patient")}, skew)
        patient = processes.pop("patient")
        _await_word(patient, "patient has a clock that stepped by +10.0 s")
        patient.send_signal(signal.SIGSTOP)
        said = {side: " ".join(process.communicate(timeout=120)[1].split()) for side, process in processes.items()}
        patient.send_signal(signal.SIGCONT)
        patient.communicate(timeout=120)
    assert any("patient was silent for" in text for text in said.values()), said  # who sees it first ends the other
    assert {side: process.returncode for side, process in processes.items()} == {"netem": 3, "surgeon": 3}, said
    code, _, _ = call("summarize", str(tmp_path / "run"))
    assert code == 5
    problems = json.loads((tmp_path / "run" / "summary.json").read_text())["problems"]
    assert any("patient's clock stepped by +10.0 s" in problem for problem in problems), problems
    out = call_in_one_line("info", "-v", str(tmp_path / "run"))[1]
    assert "patient's clock stepped by +10.0 s" in out


@pytest.mark.slow
def test_a_network_between_hosts_that_carries_nothing_is_named(
    hosts: Hosts, tmp_path: Path, without_report: None
) -> None:
    text = _SCENARIO.replace("WEST", "tls/10.77.1.1:7447").replace("EAST", "tls/10.77.2.1:7448")
    (tmp_path / "s.yaml").write_text(text.replace("DURATION", "14") + "security: {kind: mtls}\n")
    new_authority(tmp_path / "certs")
    for side in ("surgeon", "netem", "patient"):
        issue(tmp_path / "certs", side, ("10.77.1.1", "10.77.2.1") if side == "netem" else ())
        shutil.copytree(tmp_path / "certs" / side, tmp_path / side / "certs" / side)
    with ExitStack() as stack:
        processes = _sides(
            stack, tmp_path, {side: hosts.command(side) for side in ("netem", "surgeon", "patient")}, {}
        )
        log = tmp_path / "run" / "patient.mcap"
        until_s = time.monotonic() + 60
        while not (log.exists() and log.stat().st_size > 20_000):
            assert time.monotonic() < until_s
            time.sleep(0.05)
        subprocess.run([IP, "-n", hosts.netem, "link", "set", "east", "down"], check=True)
        time.sleep(5)
        subprocess.run([IP, "-n", hosts.netem, "link", "set", "east", "up"], check=True)
        said = {side: " ".join(process.communicate(timeout=120)[1].split()) for side, process in processes.items()}
    assert "warning: patient cannot be reached" in said["netem"], said
    assert "warning: patient cannot be reached" in said["surgeon"], said
    assert "warning: netem cannot be reached" in said["patient"], said
    assert "is back after" in said["netem"], said
    assert call("summarize", str(tmp_path / "run"))[0] == 5
    out = call_in_one_line("info", "-v", str(tmp_path / "run"))[1]
    assert "patient could not be reached: nothing crossed the network between the hosts" in out
