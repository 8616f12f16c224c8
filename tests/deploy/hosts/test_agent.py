"""Requests as a host executes them, on bytes in memory, and the faults that it finds."""

import io
import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tis.common.errors import InputError, TisError
from tis.deploy.hosts import hosted_side
from tis.deploy.hosts.agent import obey
from tis.deploy.hosts.hosted_side import _Lifeline, _Talk
from tis.deploy.shell.guard import version_text

_RAW: dict[str, Any] = {"version": 1, "name": "s", "source": {"kind": "synthetic"}}


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "w").mkdir()
    return tmp_path / "w"


def _said(**request: Any) -> bytes:
    out = io.BytesIO()
    assert obey(io.BytesIO(json.dumps(request).encode() + b"\nrest"), out) == 0
    return out.getvalue()


def _faults(work: Path, side: str, **scenario: Any) -> list[str]:
    here = Path.cwd()
    text = json.dumps(_RAW | scenario)  # JSON is YAML
    answer = json.loads(_said(action="check", folder=str(work), side=side, scenario=text))
    os.chdir(here)
    assert answer["version"] == version_text()
    return [fault.replace(f"{work}/", "") for fault in answer["faults"]]


def test_a_host_that_has_what_its_side_needs_has_no_faults(work: Path) -> None:
    for side in ("surgeon", "netem", "patient"):
        assert _faults(work, side) == []


def test_each_side_looks_for_its_own_files_only_and_names_all_that_are_missing(
    work: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("TIS_JIGSAWS", raising=False)
    scenario: dict[str, Any] = {
        "hosts": {"west": "tls/10.0.0.1:1", "east": "tls/10.0.0.2:1"},
        "security": {"kind": "mtls"},
        "source": {"kind": "jigsaws", "trial": "B001", "path": "trials"},
        "identification": {"train": "model.json"},
        "estimators": ["hold", "my_module:make"],
        "active_estimator": "hold",
        "network": {"forward": {"delay": {"kind": "trace", "path": "trace.csv"}}},
    }
    found = {side: _faults(work, side, **scenario) for side in ("surgeon", "netem", "patient")}
    for side, faults in found.items():
        assert sum(fault.startswith(f"certs/{side}/") for fault in faults) == 3, faults
        assert any("trials" in fault for fault in faults) == (side != "netem"), faults
        assert any("trace.csv" in fault for fault in faults) == (side == "netem"), faults
        assert any("model.json" in fault for fault in faults) == (side == "patient"), faults
        assert any("my_module" in fault for fault in faults) == (side == "patient"), faults


def test_a_folder_that_is_not_there_is_the_one_fault(work: Path) -> None:
    [fault] = _faults(work / "none", "netem", security={"kind": "password"})
    assert fault.endswith("/w/none: working folder cannot be entered: No such file or directory")


def test_a_scenario_that_is_none_is_a_fault(work: Path) -> None:
    assert _faults(work, "netem", duration_s=-1) == ["scenario: duration_s: must be greater than 0 (got -1)"]


def test_runs_are_listed_with_the_oldest_first_and_their_logs_are_read(work: Path) -> None:
    for age, run in enumerate(("b", "a")):
        folder = work / "runs" / f"{run}_on_netem"
        folder.mkdir(parents=True)
        (folder / "netem.mcap").write_bytes(b"0123456789")
        os.utime(folder, (age, age))
    (work / "runs" / "c_on_patient").mkdir()
    there = {"folder": str(work), "side": "netem"}
    assert json.loads(_said(action="runs", **there)) == {"runs": ["b", "a"]}
    [log] = json.loads(_said(action="list", run="a", parts={"netem.mcap": 3}, **there))["logs"]
    assert (log["name"], log["n_bytes"]) == ("netem.mcap", 10)
    assert _said(action="read", run="a", name="netem.mcap", begin=3, end=6, **there) == b"345"
    with pytest.raises(TisError, match="cannot be read: No such file"):
        _said(action="list", run="none", **there)


@pytest.mark.parametrize("line", [b"", b"\n", b"x" * 100, b"{}\n", b'{"action": "remove"}\n'])
def test_anything_else_is_refused(line: bytes, work: Path) -> None:
    with pytest.raises(InputError, match="no request of this version"):
        obey(io.BytesIO(line), io.BytesIO())


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = list(os.pipe())
    yield ends[0], ends[1]
    for end in ends:
        try:
            os.close(end)
        except OSError:
            continue


def test_a_side_lives_while_its_connection_talks(pipe: tuple[int, int]) -> None:
    line = _Lifeline(pipe[0])
    assert not line.is_over(0)
    os.write(pipe[1], b"alive\n")
    assert not line.is_over(0)


@pytest.mark.parametrize("said", [b"interrupt\n", b"alive\ninterrupt\n"])
def test_a_request_to_end_is_obeyed_once_and_for_all(pipe: tuple[int, int], said: bytes) -> None:
    line = _Lifeline(pipe[0])
    os.write(pipe[1], said)
    assert line.is_over(1.0)
    os.write(pipe[1], b"alive\n")
    assert line.is_over(0)


def test_the_end_of_the_connection_ends_the_side(pipe: tuple[int, int]) -> None:
    line = _Lifeline(pipe[0])
    os.close(pipe[1])
    assert line.is_over(1.0)


def test_so_does_a_connection_that_is_only_silent(pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch) -> None:
    line = _Lifeline(pipe[0])
    assert not line.is_over(0)
    monkeypatch.setattr(hosted_side, "MAX_SILENCE_S", -1.0)
    assert line.is_over(0)


def test_a_reader_that_stands_still_does_not_hold_up_the_side(
    pipe: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(hosted_side, "GRACE_S", 0.05)
    talk = _Talk(pipe[1])
    for _ in range(5000):  # more than pipe and queue hold
        talk.pass_on(b"x" * 100 + b"\n")
    assert not talk.has_begun
    talk.pass_on(b'{"side": "netem", "event": "running"}\n')
    assert talk.has_begun
    talk.close()
    os.close(pipe[0])  # its thread ends
    until_s = time.monotonic() + 20
    while not talk.is_broken:
        assert time.monotonic() < until_s
        time.sleep(0.01)
