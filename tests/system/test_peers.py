"""Lives of the sides in live runs: what stands still, cannot be reached, or has a clock that steps is named."""

import os
import shutil
import signal
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from common.runtime.free_endpoints import free_endpoints
from deploy.tools.certificates import issue, new_authority
from tests.deploy.commands import call, call_in_one_line
from tests.system.conftest import Start
from tests.system.hosts import IP, Hosts, hosts

pytestmark = pytest.mark.live
__all__ = ["hosts"]
_HOLD = ("--set", "estimators=[hold]", "--set", "active_estimator=hold")
_TIS = [sys.executable, "-m", "deploy.cli.main"]
_SLOW = """
import time
import numpy as np
from patient_side.estimators.protocol import Estimate

class Slow:
    name = "slow"
    def initial(self):
        return 0
    def step(self, state, playout, now_ns):
        if state == 60:
            time.sleep(3.0)
        return state + 1, Estimate(np.zeros(3), None)

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


@pytest.mark.parametrize(("side", "module"), [("patient", "patient_side"), ("netem", "netem")])
def test_a_side_that_stands_still_is_told_and_is_not_dead(start: Start, side: str, module: str) -> None:
    tis = start("run", "default", "--duration-s", "8", *_HOLD)
    tis.await_log("surgeon")
    victim = tis.child(module)
    os.kill(victim, signal.SIGSTOP)
    time.sleep(3)
    os.kill(victim, signal.SIGCONT)
    code, _, err = tis.wait()
    assert code == 5, err
    assert f"surgeon: warning: {side} stands still" in err
    assert f"surgeon: warning: {side} is back after" in err
    assert f"{side}: warning: this process stood still for" in err
    problems = [text for text in tis.summary()["problems"] if " at " in text and "noticed" in text]
    assert len(problems) == 1, problems
    assert problems[0].startswith(f"{side} stood still (")
    assert "clock" not in err


def test_a_side_that_is_silent_for_too_long_ends_the_run(start: Start) -> None:
    tis = start("run", "default", "--duration-s", "60", *_HOLD, "--set", "peer_timeout_s=2")
    tis.await_log("surgeon")
    victim = tis.child("patient_side")
    os.kill(victim, signal.SIGSTOP)
    try:
        until_s = time.monotonic() + 30
        while len(tis.children()) > 1 and time.monotonic() < until_s:
            time.sleep(0.1)
    finally:
        os.kill(victim, signal.SIGCONT)
    code, _, err = tis.wait()
    assert code == 3, err
    assert "patient was silent for" in " ".join(err.split())


def test_an_estimator_that_blocks_is_named(start: Start, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "slow_filter.py").write_text(_SLOW)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    names = ("--set", "estimators=[hold, 'slow_filter:factory']", "--set", "active_estimator=slow_filter:factory")
    tis = start("run", "default", "--duration-s", "8", *names)
    code, _, err = tis.wait()
    assert code == 5, err
    assert "patient does not tick: its loop has been in one step for" in " ".join(err.split())
    assert "slow_filter:factory" in err
    assert any("its loop stayed in one step (slow_filter:factory)" in text for text in tis.summary()["problems"])


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


def test_a_clock_that_steps_is_named(tmp_path: Path, without_report: None) -> None:
    west, east = free_endpoints()
    (tmp_path / "s.yaml").write_text(_SCENARIO.replace("WEST", west).replace("EAST", east).replace("DURATION", "20"))
    with ExitStack() as stack:
        skew = {"patient": {"TIS_CLOCK_SKEW": "0:0:10@9"}}
        processes = _sides(stack, tmp_path, {side: [] for side in ("netem", "surgeon", "patient")}, skew)
        said = {side: " ".join(process.communicate(timeout=120)[1].split()) for side, process in processes.items()}
    assert "patient has a clock that stepped by +10.0 s" in said["patient"], said
    code, _, _ = call("summarize", str(tmp_path / "run"))
    assert code == 5
    out = call_in_one_line("info", "-v", str(tmp_path / "run"))[1]
    assert "patient's clock stepped by +10.0 s" in out


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
