"""A run is found by another command of its user while it lasts, and only then."""

import json
import os
import stat
import tempfile
from pathlib import Path

import pytest

from tis.common.runtime import running
from tis.common.runtime.running import Running, announced, sessions

ONE = Running("tcp/127.0.0.1:4001", "tcp/127.0.0.1:4002", "tis", "scenario one")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the sessions, in a run-time folder of the test's own; no emulator on the usual port."""
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr(running, "_is_open", lambda _: False)
    return tmp_path / "tis"


def test_a_session_is_found_until_it_ends(folder: Path) -> None:
    with announced(ONE):
        assert sessions() == [ONE]
        assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert sessions() == []
    assert list(folder.iterdir()) == []


def test_a_process_that_is_gone_is_forgotten(folder: Path) -> None:
    folder.mkdir(mode=0o700)
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)
    (folder / f"{child}.json").write_text(json.dumps(ONE._asdict()))
    assert sessions() == []
    assert list(folder.iterdir()) == []


@pytest.mark.parametrize("text", ["", "[]", '{"west": 1}', '{"fnord": 1}', '{"west": "junk"}', '{"session": null}'])
def test_what_no_session_writes_is_passed_over(folder: Path, text: str) -> None:
    folder.mkdir(mode=0o700)
    (folder / f"{os.getpid()}.json").write_text(text)
    assert sessions() == []


def test_a_folder_that_others_may_write_to_is_not_believed(folder: Path, tmp_path: Path) -> None:
    folder.mkdir()
    folder.chmod(0o777)
    (folder / f"{os.getpid()}.json").write_text(json.dumps(ONE._asdict()))
    assert sessions() == []
    (tmp_path / "temporary").mkdir()
    with announced(ONE):  # in the user's temporary folder instead
        assert sessions() == [ONE]


def test_without_any_folder_a_run_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/no/such")
    with announced(ONE):
        assert sessions() == []


def test_an_emulator_on_the_usual_port_counts_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "_is_open", lambda _: True)
    assert sessions() == [Running()]
    with announced(ONE):
        assert sessions() == [ONE, Running()]
    with announced(Running(title="tis netem")):
        assert sessions() == [Running(title="tis netem")]
