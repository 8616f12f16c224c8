"""A Dask scheduler and its workers, as processes that know no folder of trials and start in a folder of their own."""

import gc
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from rich.console import Console

from tests.deploy.compare.engine.killing import KILLING
from tests.deploy.compare.untimed import untimed
from tests.documented_estimator import FILE, documented_estimator
from tis.common.errors import InputError, PeerError
from tis.common.extras import GET_CLUSTER
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine import cluster
from tis.deploy.compare.engine import cluster as module
from tis.deploy.compare.engine.cluster import Cluster
from tis.deploy.compare.engine.compute import Outcome, compute
from tis.deploy.compare.engine.workers import Processes, Workers
from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.deploy.shell.progress import PhaseProgress

_ROOT = Path(__file__).resolve().parents[4]
_START_S = 60.0
# For an own estimator all models are tried: small ones, of few samples; those of others are shipped.
SMALL = ("identification.train=others", "identification.train_samples=120", "identification.block_rows=2")

Start = Callable[..., "subprocess.Popen[bytes]"]


def started(command: list[str], folder: Path, env: dict[str, str]) -> "subprocess.Popen[bytes]":
    folder.mkdir(exist_ok=True)
    # What the tests read is the client's: the output of Dask goes to a file.
    with (folder / "output.txt").open("ab") as output:
        return subprocess.Popen(
            [sys.executable, "-m", *command], cwd=folder, env=env, stdout=output, stderr=subprocess.STDOUT
        )


@pytest.fixture(scope="module")
def environment() -> dict[str, str]:
    without = {name: value for name, value in os.environ.items() if name != "TIS_JIGSAWS"}
    return {**without, "DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "3"}


@pytest.fixture(scope="module")
def cluster_dir(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cluster")


@pytest.fixture(scope="module")
def scheduler(cluster_dir: Path, environment: dict[str, str]) -> Iterator[str]:
    """Return the address of a scheduler; it has no worker but those that are started here."""
    pytest.importorskip("distributed")
    file = cluster_dir / "scheduler" / "about.json"
    command = ["distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    process = started([*command, "--scheduler-file", str(file)], cluster_dir / "scheduler", environment)
    try:
        until(lambda: file.is_file() and file.read_text().endswith("}"))  # Dask writes it in parts
        yield json.loads(file.read_text())["address"]
    finally:
        process.terminate()
        process.wait(_START_S)


def until(there: Callable[[], bool]) -> None:
    end_s = time.monotonic() + _START_S
    while not there():
        assert time.monotonic() < end_s
        time.sleep(0.05)


@pytest.fixture(scope="module")
def worker(scheduler: str, cluster_dir: Path, environment: dict[str, str]) -> Iterator[Start]:
    """Return a function that starts a worker in a folder of this name; ``root`` is the tree that it imports."""
    running = []

    def start(name: str, *options: str, root: Path = _ROOT) -> "subprocess.Popen[bytes]":
        usual = "--nthreads 1 --nworkers 1 --no-dashboard --local-directory ."
        command = ["distributed.cli.dask_worker", scheduler, *usual.split(), *options]
        running.append(started(command, cluster_dir / name, {**environment, "PYTHONPATH": str(root)}))
        return running[-1]

    yield start
    for process in running:
        process.terminate()
    for process in running:
        process.wait(_START_S)


@pytest.fixture(scope="module")
def foreign(cluster_dir: Path, worker: Start) -> None:
    """Start a worker that has other code."""
    other = cluster_dir / "other"
    shutil.copytree(_ROOT / "tis", other / "tis", ignore=shutil.ignore_patterns("*.pyc.*"))  # being written
    with (other / "tis" / "common" / "units.py").open("a") as file:
        file.write("# changed\n")
    worker("foreign", "--no-nanny", root=other)


def computed(plan: Plan, folder: Path, workers: Workers) -> Outcome:
    with workers:
        return compute(plan.cells, plan.trainings, Store(folder), workers, PhaseProgress(Console(quiet=True)))


@pytest.mark.live  # the first one: the scheduler has no worker yet
def test_without_a_worker_or_a_scheduler_one_line_says_so(scheduler: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_FIRST_WORKER_S", 0.1)
    monkeypatch.setattr(cluster, "CONNECT_S", 2)
    monkeypatch.setattr(module, "_LOOK_EVERY_S", 0.1)
    said: list[str] = []
    with pytest.raises(PeerError, match="no worker joined the scheduler"):
        Cluster(scheduler, said.append).__enter__()
    assert said == [f"{scheduler} has no worker yet: start `dask worker {scheduler} --nthreads 1`"]
    with pytest.raises(PeerError, match=r"no Dask scheduler answers within 2 s \(got 'tcp://127.0.0.1:1'\)"):
        Cluster("tcp://127.0.0.1:1", said.append).__enter__()
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        with pytest.raises(PeerError, match="no Dask scheduler answers within 2 s"):
            Cluster(address, said.append).__enter__()
    with pytest.raises(InputError, match="must be the address of a Dask scheduler"):
        Cluster("nonsense", said.append).__enter__()


@pytest.mark.live
def test_a_worker_with_other_code_is_refused_by_name(scheduler: str, foreign: None) -> None:
    gc.collect()  # Dask closes a client that is left as garbage; within the start of another, both would wait
    with pytest.raises(PeerError, match=r"refused: it has tis [^(]+\(\w{16}\), this is tis [^(]+\(\w{16}\)"):
        Cluster(scheduler, lambda _: None).__enter__()


@pytest.mark.live
def test_a_cluster_finds_what_processes_find_and_a_killed_worker_costs_only_time(
    small: Path, own_folder: Path, tmp_path: Path, scheduler: str, foreign: None, worker: Start, cluster_dir: Path,
    in_this_process: None,
) -> None:  # fmt: skip
    """Beside a worker with other code, which is left alone."""
    (own_folder / FILE).write_text(documented_estimator())
    (own_folder / "killing_own.py").write_text(KILLING)
    settings = (*SMALL, "estimators=[hold, 'killing_own:Once']", "active_estimator=hold")
    plan = make_plan(Request(str(small), settings, duration_s=3.0, n_seeds=2))
    worker("there")  # Dask starts it anew, under another address
    output, folder = ((cluster_dir / name) for name in ("there/output.txt", "there"))
    until(lambda: "Registered to:" in output.read_text())
    (folder / "kill").touch()
    said: list[str] = []
    away = computed(plan, tmp_path / "away", Cluster(scheduler, said.append))
    assert not (folder / "kill").exists()
    assert away.failures == []
    at_home = computed(plan, tmp_path / "home", Processes(1))
    assert len(away.cells) == 4
    assert untimed(away.cells) == untimed(at_home.cells)
    assert [path.read_text() for path in sorted((tmp_path / "away" / "models").iterdir())] == [
        path.read_text() for path in sorted((tmp_path / "home" / "models").iterdir())
    ]
    assert [" refused: " in text for text in said[:2]] == [True, False]
    assert sum(" refused: " in text for text in said) == 1
    assert sum(text.startswith(f"workers (threads) of {scheduler}: tcp://") for text in said) == 1


def test_without_dask_the_error_names_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=re.escape(f"needs Dask: {GET_CLUSTER}")):
        Cluster("tcp://127.0.0.1:8786", lambda _: None).__enter__()
