"""Real processes on loopback."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.deploy.commands import call
from tis.common.records import TICKS
from tis.common.runtime.ports import free_endpoints
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.run.resolve import resolve
from tis.deploy.run.twin import build_sides
from tis.patient_side.identification.model_file import dump_models

HOLD = ("--set", "estimators=[hold]", "--set", "active_estimator=hold")
"""Settings of runs whose estimates are not looked at: they load and compute least."""
_ROOT = Path(__file__).resolve().parents[2]


_ENVIRONMENT = {"COLUMNS": "200", "PYTHONFAULTHANDLER": "1"}
_SIDES = ("tis.surgeon_side", "tis.netem", "tis.patient_side")


@dataclass
class Run:
    """A run of `tis run` under way, or over: its processes and its folder."""

    pid: int
    run_dir: Path

    def is_under_way(self) -> bool:
        raise NotImplementedError

    def children(self) -> list[int]:
        return _children(self.pid)

    def child(self, module: str) -> int:
        """Return the process id of the child that runs ``module``."""
        for pid in self.children():
            if module in _command(pid):
                return pid
        raise LookupError(module)

    def await_log(self, side: str, n_bytes: int = 20_000, timeout_s: float = 120) -> None:
        """Wait until a side's log has grown past its head."""
        path = self.run_dir / f"{side}.mcap"
        until_s = time.monotonic() + timeout_s
        while not (path.exists() and path.stat().st_size >= n_bytes):
            assert time.monotonic() < until_s, f"{path.name} does not grow"
            assert self.is_under_way(), f"the run is over, and {path.name} did not grow"
            time.sleep(0.05)

    def summary(self) -> dict[str, Any]:
        content: dict[str, Any] = json.loads((self.run_dir / "summary.json").read_text())
        return content


@dataclass
class Tis(Run):
    """A `tis` command in a process of its own."""

    process: subprocess.Popen[str]

    def is_under_way(self) -> bool:
        assert self.process.poll() is None, self.process.communicate()
        return True

    def wait(self, timeout_s: float = 120) -> tuple[int, str, str]:
        out, err = self.process.communicate(timeout=timeout_s)
        return self.process.returncode, out, err


@dataclass
class RunHere(Run):
    """A `tis run` in this process; its exit code, output and diagnostics once it is over."""

    ended: tuple[int, str, str] | None = None

    def is_under_way(self) -> bool:
        return self.ended is None

    def children(self) -> list[int]:
        return [pid for pid in super().children() if any(module in _command(pid) for module in _SIDES)]

    def wait(self) -> tuple[int, str, str]:
        assert self.ended is not None
        return self.ended


def is_right_but_for_the_machine(code: int, summary: dict[str, Any], *more: str) -> bool:
    """Tell whether a run is right, or wrong only in that a busy machine was late: no test may depend on that.

    ``more``: words of other problems that a busy machine causes in this run.
    """
    known = ("starved", "too busy", *more)
    excused = all(any(words in problem for words in known) for problem in summary["problems"])
    return excused and code == (5 if summary["problems"] else 0)


def samples_taken(logs: RunLogs) -> int:
    """Return how many samples of each stream the surgeon side took: on a busy machine it misses some and says so."""
    return sum(not row["missed"] for row in logs.of("surgeon", TICKS))


def _children(pid: int) -> list[int]:
    texts = [path.read_text() for path in Path(f"/proc/{pid}/task").glob("*/children")]
    return [int(word) for text in texts for word in text.split()]


def _command(pid: int) -> list[str]:
    """Return the words of a process's command, none when it is over."""
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode("utf-8", "replace").split("\0")
    except OSError:
        return []


Start = Callable[..., Tis]
StartHere = Callable[..., RunHere]


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
        whole = _whole(words, tmp_path / run_dir, pages, identified, request)
        process = subprocess.Popen(
            [sys.executable, "-m", "tis.deploy.cli.main", *whole],
            cwd=_ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | _ENVIRONMENT,
        )
        started.append(Tis(process.pid, tmp_path / run_dir, process))
        return started[-1]

    yield start_tis
    for tis in started:
        for pid in [*_children(tis.process.pid), tis.process.pid] if tis.process.poll() is None else []:
            os.kill(pid, signal.SIGKILL)
        tis.process.communicate()  # closes its pipes, too


@pytest.fixture
def run_here(tmp_path: Path, request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> StartHere:
    """Return a function that runs `tis run ...` to its end in this process, which spares one.

    It is for tests that neither look at that process nor send it a signal. ``meanwhile`` is called with the run in a
    thread; it must not call commands, whose output would get into the run's.
    """

    def run_tis(*words: str, identified: bool = False, meanwhile: Callable[[RunHere], None] | None = None) -> RunHere:
        run = RunHere(os.getpid(), tmp_path / "run")
        whole = _whole(words, run.run_dir, False, identified, request)

        def act() -> None:
            try:
                if meanwhile is not None:
                    meanwhile(run)
            except BaseException:  # nobody waits for the rest of the run
                for pid in run.children():
                    os.kill(pid, signal.SIGKILL)
                raise

        monkeypatch.chdir(_ROOT)
        for name, value in _ENVIRONMENT.items():
            monkeypatch.setenv(name, value)
        with ThreadPoolExecutor(1) as pool:
            acting = pool.submit(act)
            try:
                run.ended = call(*whole)
            finally:
                run.ended = run.ended or (-1, "", "")
            acting.result()
        return run

    return run_tis


def _whole(
    words: tuple[str, ...], run_dir: Path, pages: bool, identified: bool, request: pytest.FixtureRequest
) -> list[str]:
    """Return a whole command: without what most tests do not look at, which takes longer than what they do."""
    whole = [*words, "--run-dir", str(run_dir)]
    if words[0] == "run" and not pages:
        whole += ["--no-report", "--no-merge"]
    if words[:2] == ("run", "default") and not identified:
        whole += ["--set", f"identification.train={request.getfixturevalue('model_file')}"]
    return whole


@pytest.fixture
def endpoints() -> tuple[str, str]:
    """Return two free loopback endpoints."""
    return free_endpoints()
