"""Trials in the format of JIGSAWS, of several made-up subjects, and a scenario that plays them."""

import multiprocessing
from pathlib import Path

import pytest

from tis.deploy.tools.synth import write_trials

SCENARIO = """version: 1
name: small
drain_s: 0.2
source: {{kind: jigsaws, path: {path}, hands: [left]}}
network: {{forward: {{delay: {{kind: constant, delay_ms: 100}}}}}}
identification: {{train_samples: 240, block_rows: 4, order: 0}}
patient: {{orientation: {{methods: [hold], active: hold}}}}
estimators: [hold, damped_velocity]
active_estimator: damped_velocity
"""


@pytest.fixture(scope="session")
def written_trials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the trials S001 and T002, of different subjects, 500 rows each."""
    folder = tmp_path_factory.mktemp("trials") / "jigsaws"
    _, second = write_trials(folder, 2, "Suturing", 1, 500 / 30, "a test")
    second.rename(second.with_name("Suturing_T002.txt"))
    return folder


@pytest.fixture
def small(tmp_path: Path, written_trials: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a scenario file that plays the trials; the working folder is empty otherwise."""
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "small.yaml"
    path.write_text(SCENARIO.format(path=written_trials))
    return path


@pytest.fixture
def forked(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let processes begin as copies of one that has loaded what they compute with: they die as all others do."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tis.deploy.compare.engine.workers"])
    monkeypatch.setattr(multiprocessing, "get_context", lambda _: context)


@pytest.fixture
def without_figures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Write a comparison without its figures and its page: for tests that look at neither."""
    monkeypatch.setattr("tis.deploy.compare.results.files.figures_of", lambda _: {})
    monkeypatch.setattr("tis.deploy.compare.results.files.can_report", lambda: False)
