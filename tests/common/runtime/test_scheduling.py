"""Scheduling of threads, as far as it can be told without measuring."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tis.common.runtime import scheduling
from tis.common.runtime.scheduling import let_zenoh_wait, request_real_time, stand_behind


def test_every_thread_of_the_process_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []

    def ask(thread: int, policy: int, _: os.sched_param) -> None:
        asked.append((thread, policy))

    monkeypatch.setattr(os, "sched_setscheduler", ask)
    threads = {int(thread.name) for thread in Path("/proc/self/task").iterdir()}
    assert request_real_time()
    assert {thread for thread, _ in asked} >= threads & {os.getpid()}
    assert {policy for _, policy in asked} == {os.SCHED_RR}


def test_without_the_privilege_nothing_happens(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert not request_real_time()


def test_a_thread_that_has_just_ended_is_no_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: object) -> None:
        raise ProcessLookupError

    monkeypatch.setattr(os, "sched_setscheduler", gone)
    assert request_real_time()


def test_a_thread_that_gives_way_runs_behind_those_that_were_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[int, int]] = []

    def ask(thread: int, policy: int, parameters: os.sched_param) -> None:
        asked.append((policy, parameters.sched_priority))

    monkeypatch.setattr(os, "sched_setscheduler", ask)
    assert request_real_time()
    ((_, loops),) = set(asked)
    asked.clear()
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: os.SCHED_RR)
    stand_behind(0, behind=True)
    ((policy, own),) = asked
    assert policy == os.SCHED_RR
    assert own < loops
    assert own >= os.sched_get_priority_min(os.SCHED_RR)


def test_an_ordinary_thread_stays_ordinary(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *_: asked.append(1))
    monkeypatch.setattr(os, "sched_getscheduler", lambda _: os.SCHED_OTHER)
    stand_behind(0, behind=True)
    assert asked == []


@pytest.fixture
def threads(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The threads that the process seems to have: none but those of `_thread`, for other tests use Zenoh's own."""
    monkeypatch.setattr(scheduling, "_THREADS", tmp_path)
    return tmp_path


@contextmanager
def _thread(threads: Path, name: str) -> Iterator[int]:
    """Start a thread and enter it under ``name``; yield its kernel id."""
    ended = threading.Event()
    thread = threading.Thread(target=ended.wait)
    thread.start()
    own = threads / str(thread.native_id)
    own.mkdir()
    (own / "comm").write_text(f"{name}\n")
    try:
        yield thread.native_id or 0
    finally:
        ended.set()
        thread.join()


def test_only_threads_that_receive_or_send_are_made_to_wait(threads: Path) -> None:
    before = os.sched_getscheduler(0)
    with (
        _thread(threads, "rx-0") as receiving,
        _thread(threads, "tx-0") as sending,
        _thread(threads, "app-0") as other,
    ):
        let_zenoh_wait()
        assert [os.sched_getscheduler(thread) for thread in (receiving, sending)] == [os.SCHED_BATCH, os.SCHED_BATCH]
        assert os.sched_getscheduler(other) == before
    assert os.sched_getscheduler(0) == before


def test_a_receiving_thread_in_real_time_stays_there(threads: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    with _thread(threads, "rx-0"):
        monkeypatch.setattr(os, "sched_setscheduler", lambda *_: asked.append(1))
        monkeypatch.setattr(os, "sched_getscheduler", lambda _: os.SCHED_RR)
        let_zenoh_wait()
    assert asked == []


def test_a_system_that_refuses_is_no_failure(threads: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    with _thread(threads, "rx-0") as receiving:
        before = os.sched_getscheduler(receiving)
        let_zenoh_wait()
        assert os.sched_getscheduler(receiving) == before


def test_a_thread_that_has_ended_or_has_an_odd_name_is_no_failure(threads: Path) -> None:
    (threads / "1").mkdir()
    with _thread(threads, "odd") as odd, _thread(threads, "rx-0") as receiving:
        (threads / str(odd) / "comm").write_bytes(b"\xc3\n")
        let_zenoh_wait()
        assert os.sched_getscheduler(receiving) == os.SCHED_BATCH


_ROUTERS = """
import os, time
from pathlib import Path
import zenoh
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.process import run_to_end
from tis.common.runtime.scheduling import let_zenoh_wait
from tis.common.runtime.zenoh_session import ZenohOptions, configure, merge_acceptor

def waiting():
    let_zenoh_wait()
    tasks = [task for task in Path("/proc/self/task").iterdir() if os.sched_getscheduler(int(task.name)) == 3]
    return {(task / "comm").read_text()[:3] for task in tasks}

def main():
    merge_acceptor()
    here = free_endpoints()[0]
    with (
        zenoh.open(configure("router", ZenohOptions(listen=[here]))),
        zenoh.open(configure("client", ZenohOptions(connect=[here]))),
    ):
        until = time.monotonic() + 30
        while not {"rx-", "tx-"} <= waiting() and time.monotonic() < until:
            time.sleep(0.05)  # a new thread has its parent's name for a moment
        print(*sorted(waiting()), flush=True)

run_to_end(main)
"""


@pytest.mark.live
def test_zenoh_names_its_threads_as_expected() -> None:
    done = subprocess.run([sys.executable, "-c", _ROUTERS], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == ["rx-", "tx-"]
