"""Real processes on loopback."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from common.records import TICKS
from common.runtime.free_endpoints import free_endpoints
from deploy.logs.read.load import RunLogs
from deploy.run.resolve import resolve
from deploy.run.twin import build_sides
from patient_side.identification.model_io import dump_models

_ROOT = Path(__file__).resolve().parents[2]


@dataclass
class Tis:
    """A `tis` command under way."""

    process: subprocess.Popen[str]
    run_dir: Path

    def wait(self, timeout_s: float = 120) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=timeout_s)
        return self.process.returncode, out, err

    def child(self, module: str) -> int:
        """Return the process id of the child that runs ``module``."""
        for pid in _children(self.process.pid):
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            if module.encode() in words:
                return pid
        raise LookupError(module)

    def children(self) -> list[int]:
        return _children(self.process.pid)

    def await_log(self, side: str, n_bytes: int = 20_000, timeout_s: float = 120) -> None:
        """Wait until a side's log has grown past its head."""
        path = self.run_dir / f"{side}.mcap"
        until_s = time.monotonic() + timeout_s
        while not (path.exists() and path.stat().st_size >= n_bytes):
            assert time.monotonic() < until_s, f"{path.name} does not grow"
            assert self.process.poll() is None, self.process.communicate()
            time.sleep(0.05)

    def summary(self) -> dict[str, Any]:
        content: dict[str, Any] = json.loads((self.run_dir / "summary.json").read_text())
        return content


def is_right_but_for_the_machine(code: int, summary: dict[str, Any]) -> bool:
    """Tell whether a run is right, or wrong only in that a busy machine was late: no test may depend on that."""
    excused = all("starved" in problem or "too busy" in problem for problem in summary["problems"])
    return excused and code == (5 if summary["problems"] else 0)


def samples_taken(logs: RunLogs) -> int:
    """Return how many samples of each stream the surgeon side took: on a busy machine it misses some and says so."""
    return sum(not row["missed"] for row in logs.of("surgeon", TICKS))


def _children(pid: int) -> list[int]:
    text = Path(f"/proc/{pid}/task/{pid}/children").read_text()
    return [int(word) for word in text.split()]


Start = Callable[..., Tis]


@pytest.fixture(scope="session")
def model_file(tmp_path_factory: pytest.TempPathFactory, models_once: None) -> Path:
    """Return a model of the synthetic surgeon's left arm, from rows that no run with another seed than 8 plays."""
    _, models, _ = build_sides(resolve("default", (), 8, 5.0))
    path = tmp_path_factory.mktemp("model") / "model.json"
    path.write_bytes(dump_models(models))
    return path


@pytest.fixture
def start(tmp_path: Path, request: pytest.FixtureRequest) -> Iterator[Start]:
    """Return a function that starts `tis ...`; whatever still runs at the end of the test is killed.

    Runs of the scenario default read their model from a file; with ``identified`` the patient's process finds it.
    """
    started: list[Tis] = []

    def start_tis(*words: str, run_dir: str = "run", pages: bool = False, identified: bool = False) -> Tis:
        # what most tests do not look at takes longer than what they do
        if words[0] == "run" and not pages:
            words = (*words, "--no-report", "--no-merge")
        if words[:2] == ("run", "default") and not identified:
            words = (*words, "--set", f"identification.train={request.getfixturevalue('model_file')}")
        process = subprocess.Popen(
            [sys.executable, "-m", "deploy.cli.main", *words, "--run-dir", str(tmp_path / run_dir)],
            cwd=_ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, "COLUMNS": "200", "PYTHONFAULTHANDLER": "1"},
        )
        started.append(Tis(process, tmp_path / run_dir))
        return started[-1]

    yield start_tis
    for tis in started:
        for pid in [*_children(tis.process.pid), tis.process.pid] if tis.process.poll() is None else []:
            os.kill(pid, signal.SIGKILL)
        tis.process.communicate()  # closes its pipes, too


@pytest.fixture
def endpoints() -> tuple[str, str]:
    """Return two free loopback endpoints."""
    return free_endpoints()
