"""`tis up` with real sides: three namespaces with clocks of their own, and a terminal that dies."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from tests.deploy.commands import Call, call
from tests.system.conftest import is_right_but_for_the_machine, samples_taken
from tests.system.hosts import Hosts, hosts
from tis.common.channels import direction_of
from tis.common.host_records import CLOCK
from tis.common.metrics.percentiles import summarise
from tis.deploy.logs.read.load import load_run, load_side
from tis.deploy.report.subjects.latency import used_samples

pytestmark = pytest.mark.live
__all__ = ["hosts"]
_ROOT = Path(__file__).resolve().parents[2]
_TIS = f"{sys.executable} -m tis.deploy.cli.main"
_SIDES = ("surgeon", "netem", "patient")
_ENVIRONMENT = {"PYTHONPATH": str(_ROOT), "COLUMNS": "200"}
_ERRORS = {"surgeon": (3_000_000_000, 50e-6), "patient": (-2_000_000_000, -80e-6)}
"""Error of each side's clock: offset in ns, drift."""


def _write(folder: Path, model_file: Path, west: str, east: str, duration_s: int, **more: dict[str, Any]) -> Path:
    scenario = {
        "version": 1, "name": "up", "duration_s": duration_s, "source": {"kind": "synthetic"},
        "hosts": {"west": west, "east": east}, "identification": {"train": str(model_file)},
        "estimators": ["hold"], "active_estimator": "hold",
        "network": {way: {"delay": {"kind": "constant", "delay_ms": 20}} for way in ("forward", "feedback")},
    }  # fmt: skip
    (folder / "s.yaml").write_text(yaml.safe_dump(scenario))
    hosts_file: dict[str, Any] = {"scenario": "s.yaml"}
    for side in _SIDES:
        (folder / side).mkdir()
        hosts_file[side] = {"kind": "local", "folder": str(folder / side), "tis": _TIS} | more.get(side, {})
    (folder / "hosts.yaml").write_text(yaml.safe_dump(hosts_file))
    return folder / "hosts.yaml"


def _start(folder: Path, *words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [*_TIS.split(), *words, "--run-dir", str(folder / "run")],
        cwd=folder, env=os.environ | _ENVIRONMENT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


@pytest.fixture
def called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    """Return the command in this process, in the folder of the test and the environment of the hosts."""
    monkeypatch.chdir(tmp_path)
    for name, value in _ENVIRONMENT.items():
        monkeypatch.setenv(name, value)
    return call


def _true_ns(shown_ns: NDArray[np.int64], side: str) -> NDArray[np.int64]:
    """Return what this machine's clock showed when a side's wrong one showed ``shown_ns``."""
    offset_ns, drift = _ERRORS[side]
    ns: NDArray[np.int64] = np.rint((shown_ns - offset_ns) / (1 + drift)).astype(np.int64)
    return ns


@pytest.mark.slow
def test_three_hosts_with_wrong_clocks_make_one_run_with_true_delays(
    hosts: Hosts, tmp_path: Path, model_file: Path, called: Call
) -> None:
    """Both clocks are wrong by known functions of this machine's, so the true delay of each message is known."""
    skews = {"surgeon": "3:50", "netem": None, "patient": "-2:-80"}
    more = {
        side: {"kind": "namespace", "namespace": getattr(hosts, side)} | ({"clock_skew": skew} if skew else {})
        for side, skew in skews.items()
    }
    file = _write(tmp_path, model_file, "tcp/10.77.1.1:7447", "tcp/10.77.2.1:7448", 4, **more)
    code, out, err = called("up", str(file), "--insecure", "--no-merge", "--run-dir", str(tmp_path / "run"))
    run = tmp_path / "run"
    names = {path.name for path in run.iterdir()}
    assert names >= {"scenario.yaml", "summary.json", "manifest.json", "report.html"}, err
    assert {name for name in names if name.endswith(".mcap")} == {f"{side}.mcap" for side in _SIDES}
    summary = json.loads((run / "summary.json").read_text())
    assert is_right_but_for_the_machine(code, summary), out + err
    assert "Unknown child" not in err
    assert json.loads((run / "manifest.json").read_text())["exit_codes"] == dict.fromkeys(_SIDES, 0)
    kinds = {side: clock["kind"] for side, clock in summary["clocks"].items()}
    assert kinds == {"surgeon": "exchanged", "netem": "reference", "patient": "exchanged"}

    logs = load_run(run)
    raw = {side: load_side(run / f"{side}.mcap", side) for side in ("surgeon", "patient")}
    epoch_ns = {side: log.of(CLOCK)[0]["epoch_ns"] for side, log in raw.items()}
    used = used_samples(logs, "tis", {"left": "PSM2"})
    used_truth_ns, n_messages = [], 0
    for key, sent in raw["patient"].messages.items():
        if direction_of(key, "tis") == "forward":
            true_sent_ns = _true_ns(sent.sent_ns + epoch_ns["surgeon"], "surgeon")
            truth_ns = _true_ns(sent.log_ns + epoch_ns["patient"], "patient") - true_sent_ns
            found = logs.sides["patient"].messages[key]
            doubt_ns = logs.clocks.uncertainty_ns("surgeon", found.sent_ns, "patient", found.log_ns)
            assert doubt_ns is not None
            assert doubt_ns.min() > 0
            assert (np.abs(found.log_ns - found.sent_ns - truth_ns) <= doubt_ns + 1).all(), key
            used_truth_ns.append(truth_ns[np.isin(found.sent_ns, used.sent_ns)])
            n_messages += len(truth_ns)
    assert n_messages > (80 if samples_taken(logs) < 210 else 200)
    true_ns = np.concatenate(used_truth_ns)
    assert len(true_ns) == len(used.sent_ns) > 10
    truth, bounds = summarise(true_ns), summary["uncertainty_ms"]["latency_ms.network"]
    for name in ("p50", "p95", "p99", "max"):
        true = truth[name]
        assert true is not None
        assert abs(summary["latency_ms"]["network"][name] - true / 1e6) <= bounds[name], name


@pytest.mark.slow
def test_a_run_whose_terminal_died_is_collected_afterwards(
    tmp_path: Path, model_file: Path, endpoints: tuple[str, str], called: Call
) -> None:
    file = _write(tmp_path, model_file, *endpoints, 60)
    process = _start(tmp_path, "up", str(file))
    until_s = time.monotonic() + 120
    while not all(any(log.stat().st_size > 20_000 for log in tmp_path.glob(f"{s}/runs/*/{s}.mcap")) for s in _SIDES):
        assert time.monotonic() < until_s
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    code, err = 0, ""
    for _ in range(20):  # the sides close their logs; a log that grows meanwhile is fetched as far as it reaches
        words = ("collect", str(file), "--no-report", "--no-merge", "--run-dir", str(tmp_path / "run"))
        code, _, err = called(*words)
        summary = json.loads((tmp_path / "run" / "summary.json").read_text())
        if not any("truncated" in problem or "damaged" in problem for problem in summary["problems"]):
            break
    assert code == 5, err
    assert {path.name for path in (tmp_path / "run").glob("*.mcap")} == {f"{side}.mcap" for side in _SIDES}
    assert all("is here already" in line or "from " in line for line in err.splitlines() if ".mcap" in line)
    assert load_run(tmp_path / "run").all_covered
