"""What makes a process fit for real time, as far as it can be told without measuring."""

import os
from pathlib import Path

import pytest

from common import messages, records
from common.runtime.inbox import request_real_time, stand_behind
from common.runtime.json_schema import flat_schema, prepare_schemas


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


def test_no_schema_is_left_to_be_worked_out_in_a_run() -> None:
    for module in (messages, records):
        prepare_schemas(module)
    before = flat_schema.cache_info().misses
    for model in (messages.Pose, messages.FeedbackPose, records.TickNote, records.EstimateNote, records.FateBatch):
        flat_schema(model)
    assert flat_schema.cache_info().misses == before
