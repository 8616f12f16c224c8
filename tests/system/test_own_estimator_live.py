"""Three processes with an estimator of the user's own that is found in the current folder, and acts."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.documented_estimator import FILE, NAME, documented_estimator
from tests.system.conftest import is_right_but_for_the_machine
from tis.deploy.run.replay import replay

pytestmark = pytest.mark.live
_ROOT = Path(__file__).resolve().parents[2]


def tis(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, "PYTHONPATH": str(_ROOT), "COLUMNS": "200"}
    command = [
        sys.executable,
        "-P",
        "-c",
        "from tis.deploy.cli.main import main; main()",
        *words,
    ]
    return subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=120, check=False
    )


@pytest.mark.slow
def test_it_acts_fails_at_times_and_replays(own_folder: Path, model_file: Path) -> None:
    failing = documented_estimator().replace(
        "        arm = playout.arm\n", "        arm = playout.arm\n        assert arm.newest % 20 != 7, 'a bad day'\n"
    )
    (own_folder / FILE).write_text(failing)
    for name in ("common", "deploy", "netem", "patient_side", "surgeon_side"):  # the user's own, by the same names
        (own_folder / name).mkdir()
        (own_folder / name / "__init__.py").write_text("raise ImportError('not the testbed')\n")
    done = tis(own_folder, "run", "default", "--duration-s", "4", "--run-dir", "run", "--no-report", "--no-merge",
               "--set", f"identification.train={model_file}", "--set", f"estimators=[hold, {NAME}]",
               "--set", f"active_estimator={NAME}")  # fmt: skip
    summary = json.loads((own_folder / "run" / "summary.json").read_text())
    (silent,) = [problem for problem in summary["problems"] if "gave no estimate" in problem]
    others = {"problems": [problem for problem in summary["problems"] if problem != silent]}
    assert done.returncode == 5
    assert is_right_but_for_the_machine(5 if others["problems"] else 0, others), done.stderr
    own = summary["own_estimators"][NAME]
    assert own["file"] == FILE
    assert own["first_fault"]["reason"] == "AssertionError: a bad day"
    assert own["faulty_steps"] > 0
    begun = summary["ticks"]["count"] - summary["ticks"]["missed"]
    # an answer and a pose of the arm for each tick: what it did not say was not sent
    assert summary["links"]["feedback"]["sent"] < 2 * begun - own["faulty_steps"] + 1
    found = replay(own_folder / "run")
    assert found.identical
    assert found.changed == ()
