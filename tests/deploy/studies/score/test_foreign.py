"""A process as an estimator: the specified lines, and every way to break them, each a fault that is told."""

import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from tests.test_source import ROOT
from tis.common.errors import InputError
from tis.deploy.studies.score import foreign
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

HOLD = """
import json, sys
place, newest = None, -1
for line in sys.stdin:
    asked = json.loads(line)
    if asked["type"] == "begin":
        answer = {"type": "ready"}
    else:
        for index, *position in asked["arm"]:
            if index > newest:
                newest, place = index, position
        answer = {"position_m": place}
    print(json.dumps(answer), flush=True)
"""


class _Model:
    hand = "left"


MODEL = cast("ArmModel", _Model())


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Any]:
    """Return a function that announces a program and gives its estimator."""

    def start(program: str) -> foreign.ForeignEstimator:
        file = tmp_path / "program.py"
        file.write_text(program, "utf-8")
        foreign.announce([sys.executable, str(file)], ["a.csv"])
        return foreign.ForeignEstimator(MODEL)

    yield start
    foreign._FAILED.clear()


def test_a_process_gets_what_is_new_and_its_answer_counts(started: Any) -> None:
    estimator, playout = started(HOLD), Playout(30)
    state, found = estimator.step(estimator.initial(), playout, 0)
    assert (state, found.position_m) == ((0, 0), None)
    playout.arm.add(0, np.array([0.1, 0.2, 0.3]))
    playout.arm.add(2, np.array([0.4, 0.5, 0.6]))
    state, found = estimator.step(state, playout, 1)
    assert state == (2, 0)
    assert found.position_m.tolist() == [0.4, 0.5, 0.6]
    playout.arm.add(1, np.zeros(3))  # overtaken
    _, found = estimator.step(state, playout, 2)
    assert found.position_m.tolist() == [0.4, 0.5, 0.6]


@pytest.mark.parametrize(
    ("answer", "why"),
    [
        ("raise SystemExit(3)", "ended with exit code 3"),
        ("import os; os.kill(os.getpid(), 9)", "ended with signal 9"),
        ("print('what?', flush=True)", "answered no JSON: b'what?'"),
        ("print('[' * 50_000, flush=True)", "answered no JSON"),
        ("print('{}', flush=True)", "must answer position_m"),
        ("print('[1, 2, 3]', flush=True)", "must answer position_m"),
        ("print('{\"position_m\": [NaN, 0, 0]}', flush=True)", "position_m must be 3 finite numbers"),
        ("print('{\"position_m\": [0, 0]}', flush=True)", "position_m must be 3 finite numbers"),
        ('print(\'{"position_m": ["a", 0, {}]}\', flush=True)', "position_m must be 3 finite numbers"),
        (
            'print(\'{"position_m": [0, 0, 0], "covariance_m2": [1]}\', flush=True)',
            "covariance_m2 must be 3 x 3 finite",
        ),
        ('print(\'{"position_m": null}\\n{"position_m": null}\', flush=True)', "answered more than one line"),
        ("sys.stdout.write('x' * 200_000); sys.stdout.flush()", "answered a line of more than 65536 bytes"),
        ("import time; time.sleep(60)", "did not answer within 0.2 s"),
    ],
)
def test_whatever_else_it_answers_is_a_fault_and_the_process_is_killed(
    started: Any, answer: str, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(foreign, "STEP_S", 0.2 if "sleep" in answer else 20.0)
    ready = 'import sys\nsys.stdin.readline(); print(\'{"type": "ready"}\', flush=True); sys.stdin.readline()\n'
    estimator = started(f"{ready}{answer}\nsys.stdin.readline()")
    with pytest.raises(foreign.ForeignFault, match=re.escape(why)):
        estimator.step(estimator.initial(), Playout(30), 0)
    assert estimator._process._child.poll() is not None
    # it is not tried again
    with pytest.raises(foreign.ForeignFault, match=re.escape(why)):
        foreign.ForeignEstimator(MODEL).step((0, 0), Playout(30), 0)


def test_the_first_line_must_be_answered_by_ready(started: Any) -> None:
    estimator = started("print('{}', flush=True)\nimport sys; sys.stdin.read()")
    with pytest.raises(foreign.ForeignFault, match=r"must answer .*ready.* first"):
        estimator.step(estimator.initial(), Playout(30), 0)


def test_a_command_without_a_program_is_refused() -> None:
    for text in ("no_such_program --x", "", "'unclosed"):
        with pytest.raises(InputError):
            foreign.command_of(text, "tis score")


def test_the_manual_holds_the_vectors_and_they_are_the_specified_lines() -> None:
    page = (ROOT / "docs" / "research" / "scoreboard.md").read_text("utf-8")
    lines = [f"{mark} {json.dumps(each)}" for pair in foreign.VECTORS for mark, each in zip("><", pair, strict=True)]
    assert "\n".join(lines) in page
    for _, answer in foreign.VECTORS[1:]:
        foreign.estimate_of(json.loads(json.dumps(answer)))


def test_a_process_that_holds_passes_the_vectors(started: Any) -> None:
    started(HOLD)
    process = foreign.Process(json.loads(os.environ[foreign.VARIABLE])["command"])
    for asked, answer in foreign.VECTORS:
        assert process.ask(asked, 20.0).get("position_m") == answer.get("position_m")
    process.close()


def test_a_log_line_is_quoted_beside_the_answer(started: Any) -> None:
    ready = 'import sys\nsys.stdin.readline(); print(\'{"type": "ready"}\', flush=True); sys.stdin.readline()\n'
    estimator = started(f"{ready}sys.stdout.write('age 3\\n{{}}\\n'); sys.stdout.flush(); sys.stdin.readline()")
    with pytest.raises(foreign.ForeignFault, match=r"b'age 3', and b'\{\}"):
        estimator.step(estimator.initial(), Playout(30), 0)


def test_a_rehearsal_asks_the_vectors_lines(tmp_path: Path) -> None:
    file = tmp_path / "program.py"
    file.write_text(HOLD, "utf-8")
    command = [sys.executable, str(file)]
    assert foreign.rehearsed(command, ["a.csv"]) is None
    own = foreign.digest_of_files(command)
    file.write_text(HOLD.replace('"position_m": place', '"position_m": place and place[:2]'), "utf-8")
    assert "position_m must be 3 finite numbers" in (foreign.rehearsed(command, []) or "")
    assert foreign.digest_of_files(command) != own
    assert foreign.digest_of_files(["node"]) is None
