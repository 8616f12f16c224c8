"""Fixtures that every part of the tests shares."""

import gc
import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from hypothesis import settings
from typer.main import get_command

from tests.deploy.compare.in_this_process import InThisProcess
from tests.models_once import models_identified

# The same examples on every machine, and no deadline on a busy one.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")

_ROOT = Path(__file__).resolve().parents[1]


def pytest_make_parametrize_id(val: object) -> str | None:
    """Name a long value by its beginning: pytest-xdist sends all names to and fro, and one value has 4 MB."""
    return f"{val[:40]!r}... ({len(val)})" if isinstance(val, (str, bytes)) and len(val) > 100 else None


@pytest.hookimpl(tryfirst=True)  # before pytest-xdist looks for groups
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let one worker run the runs of three processes, and one all other live tests.

    Beside each other those of a group would disturb each other; but each of the groups mostly waits. They come first:
    at the end nothing would be left to do meanwhile. Of the others a worker takes whole files: what tests share is
    made once.
    """
    items.sort(key=lambda item: item.get_closest_marker("live") is None)
    for item in items:
        group = item.path.stem
        if item.get_closest_marker("live") is not None:
            alone = "test_transparent" in item.path.name or "test_view" in item.path.name
            group = "runs" if "system" in item.path.parts and not alone else "live"
        item.add_marker(pytest.mark.xdist_group(group))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Take what collecting made out of the garbage collector's sight: runs collect often and would look at it all."""
    if session.config.getoption("loadgroup", False) and not all("@" in item.nodeid for item in session.items):
        raise pytest.UsageError("pytest-xdist ignores groups: live tests would run beside each other")
    gc.collect()
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)  # what runs make has few cycles, and looking for them takes a hundredth of all


@pytest.fixture(scope="session")
def of_all_workers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder of this session that all its workers have in common."""
    own = tmp_path_factory.getbasetemp()
    path = (own.parent if "PYTEST_XDIST_WORKER" in os.environ else own) / "of_all_workers"
    path.mkdir(exist_ok=True)
    return path


@pytest.fixture(scope="session", autouse=True)
def commands_once() -> Iterator[None]:
    """Build the commands of `tis` once: Typer's runner does so for each call, which often takes longest of it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("typer.testing._get_command", cache(get_command))
        yield


@pytest.fixture(scope="session", autouse=True)
def models_once(of_all_workers: Path) -> Iterator[None]:
    """Identify each model once in this session, unless a test asks for `models_anew`."""
    with models_identified(of_all_workers):
        yield


@pytest.fixture
def models_anew(models_once: None) -> Iterator[None]:
    """Identify each model when a run of this test begins: what it shows includes that the model is the same again."""
    with models_identified(None):
        yield


@pytest.fixture
def without_report(monkeypatch: pytest.MonkeyPatch) -> None:
    """Sum up without a report: for tests that do not look at it, of folders whose report another test makes."""
    monkeypatch.setattr("tis.deploy.report.command.can_report", lambda: False)


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let `tis compare` compute in this process: for tests that do not look at its processes."""
    monkeypatch.setattr("tis.deploy.compare.engine.workers.ProcessPoolExecutor", InThisProcess)


@pytest.fixture(scope="session")
def jigsaws_dir() -> Path:
    """Return the folder of real trials; skips where there is none, as the data set may not be redistributed."""
    path = Path(os.environ.get("TIS_JIGSAWS", _ROOT.parent / "shared" / "data" / "jigsaws"))
    if not path.is_dir():
        pytest.skip("no JIGSAWS trials here: set TIS_JIGSAWS to the folder that holds Suturing/, ...")
    return path


@pytest.fixture
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Return a new folder that is the current one; what is imported from it is forgotten at the end."""
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name, module in list(sys.modules.items()):
        if Path(getattr(module, "__file__", None) or "/").is_relative_to(tmp_path):
            del sys.modules[name]
