"""Processes that die while they compute: nothing but the unit that ends its own process is lost."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from tests.deploy.compare.engine.killing import KILLING
from tests.deploy.compare.in_this_process import InThisProcess
from tests.deploy.compare.untimed import untimed
from tests.documented_estimator import FILE, documented_estimator
from tis.common.runtime.recordings import load_recording
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import Outcome, compute
from tis.deploy.compare.engine.workers import Processes
from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.deploy.shell.progress import PhaseProgress

ALWAYS = """
class Always(AlphaBeta):
    def step(self, state, playout, now_ns):
        if playout.arm.newest == 50 and playout.arm.get(50)[0] == float(Path("x_m").read_text()):
            os.kill(os.getpid(), signal.SIGKILL)
        return super().step(state, playout, now_ns)
"""


SLOW = """
import os, time
from pathlib import Path
from my_filter import AlphaBeta

class Slow(AlphaBeta):
    def step(self, state, playout, now_ns):
        Path("pids").mkdir(exist_ok=True)
        (Path("pids") / str(os.getpid())).touch()
        time.sleep(1.0)
        return super().step(state, playout, now_ns)
"""


SCRIPT = """
from tis.deploy.compare import Study, compare
study = Study(scenario="default", estimators=["hold"], settings={"identification.train_samples": 300}, duration_s=4)
GUARD compare(study, "kept", n_jobs=2)
"""


# For an own estimator all models are tried: small ones, of few samples.
SMALL = ("identification.train=own_head", "identification.train_samples=120", "identification.block_rows=2")


@pytest.fixture
def there(small: Path, own_folder: Path) -> Path:
    (own_folder / FILE).write_text(documented_estimator())
    (own_folder / "killing_own.py").write_text(KILLING + ALWAYS)
    return small


def plan_with(there: Path, name: str, **changes: Any) -> Plan:
    settings = (*SMALL, f"estimators=[hold, 'killing_own:{name}']", "active_estimator=hold")
    return make_plan(Request(str(there), settings, duration_s=3.0, **changes))


def computed(plan: Plan, folder: Path) -> Outcome:
    with Processes(2) as workers:
        return compute(plan.cells, plan.trainings, Store(folder), workers, PhaseProgress(Console(quiet=True)))


def test_a_killed_process_costs_nothing_but_time(there: Path, tmp_path: Path, forked: None) -> None:
    plan = plan_with(there, "Once", n_seeds=3)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("tis.deploy.compare.engine.workers.ProcessPoolExecutor", InThisProcess)
        undisturbed = computed(plan, tmp_path / "undisturbed")
    Path("kill").touch()
    disturbed = computed(plan, tmp_path / "disturbed")
    assert not Path("kill").exists()
    assert (undisturbed.failures, disturbed.failures) == ([], [])
    assert len(undisturbed.cells) == 6
    assert untimed(disturbed.cells) == untimed(undisturbed.cells)


def test_what_ends_its_process_each_time_fails_alone(there: Path, tmp_path: Path, forked: None) -> None:
    plan = plan_with(there, "Always", n_seeds=2)
    # The place at which the twins of the first trial die.
    recording = load_recording(next(cell.scenario for cell in plan.cells if cell.trial == "S001"))
    x_m = recording.hands[0].follower.position_m[recording.start + 50, 0]
    Path("x_m").write_text(repr(float(x_m)))
    outcome = computed(plan, tmp_path / "kept")
    assert {failure.reason for failure in outcome.failures} == {"its process died, twice (out of memory?)"}
    assert sorted(failure.label for failure in outcome.failures) == ["S001, seed 1", "S001, seed 2"]
    assert {result["trial"] for result in outcome.cells.values()} == {"T002"}


@pytest.mark.parametrize(("guard", "code"), [("", 1), ('if __name__ == "__main__": ', 0)])
def test_a_script_without_a_guard_is_told_so(tmp_path: Path, guard: str, code: int) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.replace("GUARD ", guard))
    done = subprocess.run([sys.executable, script], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == code
    assert done.stderr.count("Traceback") == code
    assert ("InputError: compare: must be called below if __name__" in done.stderr) == bool(code)


def test_workers_end_with_a_client_that_is_killed(there: Path, own_folder: Path) -> None:
    (own_folder / "slow_own.py").write_text(SLOW)
    own = (*SMALL, "estimators=[hold, 'slow_own:Slow']", "active_estimator=hold")
    settings = [f"--set={text}" for text in own]
    command = [
        sys.executable,
        "-m",
        "tis.deploy.cli.main",
        "compare",
        str(there),
        "--duration-s=4",
        "--jobs=2",
        *settings,
    ]
    client = subprocess.Popen(command, stderr=subprocess.PIPE)
    pids = Path("pids")
    until(lambda: pids.is_dir() and len(list(pids.iterdir())) == 2)
    client.kill()
    client.communicate()
    until(lambda: not any(Path("/proc", file.name).is_dir() for file in pids.iterdir()))


def until(there: Callable[[], bool]) -> None:
    """Wait, for a minute at most."""
    for _ in range(1200):
        if there():
            return
        time.sleep(0.05)
    pytest.fail("not within a minute")


def test_what_another_comparison_has_stored_is_not_computed_again(
    there: Path, tmp_path: Path, in_this_process: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It stores the second cell while the first one is computed."""
    plan = plan_with(there, "Once", n_seeds=3)
    store = Store(tmp_path / "kept")
    made: list[str] = []
    save_cell = Store.save_cell

    def saved(self: Store, digest: str, result: dict[str, Any]) -> None:
        made.append(digest)
        save_cell(self, digest, result)
        if len(made) == 1:
            for cell in plan.cells:
                if self.cell(cell.digest) is None:
                    save_cell(self, cell.digest, result)

    monkeypatch.setattr(Store, "save_cell", saved)
    with Processes(1) as workers:
        outcome = compute(plan.cells, plan.trainings, store, workers, PhaseProgress(Console(quiet=True)))
    assert len(outcome.cells) == len(plan.cells) == 6
    assert len(made) < 6


def test_sigterm_ends_the_workers_before_this_process() -> None:
    """The default would leave their semaphores to be complained of."""
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(SystemExit) as left, Processes(1):
        os.kill(os.getpid(), signal.SIGTERM)
    assert left.value.code == 128 + signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) == before
