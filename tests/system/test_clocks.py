"""A side on another host, as far as its clock can tell: 3 s ahead, 50 ppm fast, another boot id."""

import json
import os
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.deploy.commands import call
from tests.system.conftest import is_right_but_for_the_machine, samples_taken
from tis.common.host_records import CLOCK
from tis.deploy.logs.read.load import load_run, load_side

pytestmark = pytest.mark.live
_ROOT = Path(__file__).resolve().parents[2]
_TIS = [sys.executable, "-m", "tis.deploy.cli.main"]
KEY = "tis/MTML/measured_cp"
OFFSET_NS = 3_000_000_000
DRIFT = 50e-6

SCENARIO = """\
version: 1
name: apart
duration_s: 4
source: {{kind: synthetic}}
hosts: {{west: {west}, east: {east}}}
estimators: [hold]
active_estimator: hold
network:
  forward: {{delay: {{kind: constant, delay_ms: 20}}}}
  feedback: {{delay: {{kind: constant, delay_ms: 20}}}}
"""


def test_one_way_delays_under_a_wrong_clock_lie_within_the_stated_uncertainty(
    tmp_path: Path, endpoints: tuple[str, str], without_report: None
) -> None:
    """Its clock is wrong by a known function of this machine's, so the true delay of each message is known."""
    west, east = endpoints
    scenario = tmp_path / "s.yaml"
    scenario.write_text(SCENARIO.format(west=west, east=east))
    processes: dict[str, subprocess.Popen[str]] = {}
    with ExitStack() as stack:
        for side in ("netem", "patient", "surgeon"):
            words = [*_TIS, side, str(scenario), "--run-dir", str(tmp_path / side), "--wait-s", "60"]
            skew = {"TIS_CLOCK_SKEW": "3:50"} if side == "surgeon" else {}
            process = subprocess.Popen(
                words,
                cwd=_ROOT,
                env={**os.environ, **skew},
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
            )
            processes[side] = stack.enter_context(process)
            stack.callback(process.kill)
        said = {side: process.communicate(timeout=120)[1] for side, process in processes.items()}
    assert {side: process.returncode for side, process in processes.items()} == dict.fromkeys(said, 0), said
    gathered = tmp_path / "gathered"
    gathered.mkdir()
    for side in processes:
        shutil.copy(tmp_path / side / f"{side}.mcap", gathered)

    raw = {side: load_side(gathered / f"{side}.mcap", side) for side in ("surgeon", "patient")}
    epoch_ns = {side: log.of(CLOCK)[0]["epoch_ns"] for side, log in raw.items()}
    sent = raw["patient"].messages[KEY]
    true_sent_ns = _true_ns(sent.sent_ns + epoch_ns["surgeon"])
    truth_ns = sent.log_ns + epoch_ns["patient"] - true_sent_ns

    logs = load_run(gathered)
    found = logs.sides["patient"].messages[KEY]
    doubt_ns = logs.clocks.uncertainty_ns("surgeon", found.sent_ns, "patient", found.log_ns)
    assert doubt_ns is not None
    assert len(truth_ns) > (40 if samples_taken(logs) < 110 else 100)
    assert (np.abs(found.log_ns - found.sent_ns - truth_ns) <= doubt_ns + 1).all()
    assert doubt_ns.min() > 0

    code, out, err = call("summarize", str(gathered))
    summary = json.loads((gathered / "summary.json").read_text())
    assert is_right_but_for_the_machine(code, summary), out + err
    clocks = summary["clocks"]
    assert {side: clock["kind"] for side, clock in clocks.items()} == {
        "surgeon": "exchanged", "netem": "reference", "patient": "shared",
    }  # fmt: skip
    surgeon = clocks["surgeon"]
    now_ms = epoch_ns["surgeon"] / 1e6
    assert surgeon["offset_ms"] == pytest.approx(_true_ns(np.array([epoch_ns["surgeon"]]))[0] / 1e6 - now_ms, abs=5)
    assert surgeon["drift_ppm"] == pytest.approx(-50, abs=max(surgeon["drift_uncertainty_ppm"], 50))
    assert surgeon["n_exchanges"] >= 24
    assert summary["uncertainty_ms"]["latency_ms.network"]["p50"] > 0
    assert "\u00b1" in out


def _true_ns(shown_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return what this machine's clock showed when the wrong one showed ``shown_ns``."""
    ns: NDArray[np.int64] = np.rint((shown_ns - OFFSET_NS) / (1 + DRIFT)).astype(np.int64)
    return ns
