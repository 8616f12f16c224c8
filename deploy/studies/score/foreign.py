"""An estimator that is a process of any language: a line of JSON to its standard input, a line of JSON back.

docs/research/scoreboard.md specifies the lines; `VECTORS` are examples of it. The process is hostile until its answer
is checked: after the first fault it is killed, and whatever it was asked since has no estimate.
"""

import hashlib
import json
import os
import select
import shlex
import shutil
import signal
import subprocess
import time
import weakref
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from tis.common.errors import Fault, InputError
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.playout import Playout, SourceBuffer
from tis.patient_side.statespace import ArmModel

NAME: Final = f"{__name__}:ForeignEstimator"
VARIABLE: Final = "TIS_SCORE_PROCESS"
"""Environment variable with command and training tables as JSON, for the workers' processes."""
BEGIN_S: Final = 120.0
"""Time for the answer to the first line, in which a process may train."""
STEP_S: Final = 2.0
MAX_LINE: Final = 65_536
_FIRST_ANSWER: Final = {"type": "ready"}
_FAILED: dict[str, str] = {}
"""Why a command failed in this process: it is not tried again, as each time might take as long as is allowed."""

VECTORS: Final[tuple[tuple[Mapping[str, Any], Mapping[str, Any]], ...]] = (
    ({"type": "begin", "version": 1, "rate_hz": 30, "hand": "left", "training": []}, _FIRST_ANSWER),
    (
        {"type": "step", "now_ns": 2000000, "newest": -1, "arm": [], "command": []},
        {"position_m": None},
    ),
    (
        {
            "type": "step",
            "now_ns": 35333333,
            "newest": 0,
            "arm": [[0, 0.1, -0.05, 0.02]],
            "command": [[0, 0.2, -0.1, 0.34]],
        },
        {"position_m": [0.1, -0.05, 0.02]},
    ),
    (
        {"type": "step", "now_ns": 68666667, "newest": 0, "arm": [], "command": []},
        {
            "position_m": [0.1, -0.05, 0.02],
            "covariance_m2": [[1e-06, 0.0, 0.0], [0.0, 1e-06, 0.0], [0.0, 0.0, 1e-06]],
        },
    ),
)
"""Lines and answers to them, of a process that holds the freshest position."""


class ForeignFault(Exception):  # noqa: N818  the guard counts it, and tells it as the process's fault
    """A process broke the protocol, or died."""


def command_of(text: str, where: str) -> list[str]:
    """Return the words of a command whose program is there; raises `InputError`."""
    try:
        words = shlex.split(text)
    except ValueError as error:
        raise InputError(Fault(where, "ESTIMATOR", f"is no command: {error}", text)) from None
    if not words or shutil.which(words[0]) is None:
        rule = "must be a shipped estimator, module:factory, or a command whose program is found"
        raise InputError(Fault(where, "ESTIMATOR", rule, text))
    return words


def announce(command: Sequence[str], training: Sequence[str]) -> None:
    """Tell the worker processes, which inherit the environment, what to start."""
    _FAILED.clear()
    os.environ[VARIABLE] = json.dumps({"command": list(command), "training": list(training)})


def rehearsed(command: Sequence[str], training: Sequence[str]) -> str | None:
    """Return why a command breaks the protocol at the lines of `VECTORS`, before minutes are spent on twins."""
    process = None
    try:
        process = Process(command)
        _begin(process, {**VECTORS[0][0], "training": list(training)})
        for asked, _ in VECTORS[1:]:
            estimate_of(process.ask(asked, STEP_S))
    except ForeignFault as fault:
        return f"the example's lines, {fault}"
    finally:
        if process is not None:
            process.close()
    return None


def digest_of_files(command: Sequence[str]) -> str | None:
    """Return the SHA-256 of the files that a command names, such as its script; None where it names none."""
    files = [Path(word) for word in command[1:] if Path(word).is_file()]
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest() if files else None


class Process:
    """One running process, and its lines."""

    def __init__(self, command: Sequence[str]) -> None:
        self._name = command[0]
        try:
            # A session of its own: all that it starts is killed with it.
            self._child = subprocess.Popen(
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
                bufsize=0,
            )
        except OSError as error:
            raise ForeignFault(f"{self._name} cannot be started: {error.strerror}") from None
        self._rest = b""
        assert self._child.stdin is not None
        os.set_blocking(self._child.stdin.fileno(), False)
        self._close = weakref.finalize(self, _end, self._child)

    def ask(self, message: Mapping[str, Any], within_s: float) -> Any:
        """Send a line and return the line that answers it, parsed; raises `ForeignFault`."""
        until_s = time.monotonic() + within_s
        self._send(json.dumps(message).encode() + b"\n", until_s, within_s)
        line = self._line(until_s, within_s)
        try:
            return json.loads(line)
        except (ValueError, RecursionError):
            raise ForeignFault(f"answered no JSON: {line[:80]!r}") from None

    def close(self) -> None:
        """End the process."""
        self._close()

    def _send(self, data: bytes, until_s: float, within_s: float) -> None:
        assert self._child.stdin is not None
        pipe = self._child.stdin.fileno()
        while data:
            _, ready, _ = select.select([], [pipe], [], max(0.0, until_s - time.monotonic()))
            if not ready:
                raise ForeignFault(f"read nothing within {within_s:g} s")
            try:
                data = data[os.write(pipe, data) :]
            except OSError:
                raise ForeignFault(self._death()) from None

    def _line(self, until_s: float, within_s: float) -> bytes:
        assert self._child.stdout is not None
        pipe = self._child.stdout.fileno()
        while b"\n" not in self._rest:
            if len(self._rest) > MAX_LINE:
                raise ForeignFault(f"answered a line of more than {MAX_LINE} bytes")
            ready, _, _ = select.select([pipe], [], [], max(0.0, until_s - time.monotonic()))
            if not ready:
                raise ForeignFault(f"did not answer within {within_s:g} s")
            part = os.read(pipe, MAX_LINE)
            if not part:
                raise ForeignFault(self._death())
            self._rest += part
        line, _, self._rest = self._rest.partition(b"\n")
        if self._rest:
            raise ForeignFault(f"answered more than one line: {line[:80]!r}, and {self._rest[:80]!r}")
        return line

    def _death(self) -> str:
        try:
            code = self._child.wait(1.0)
        except subprocess.TimeoutExpired:
            return "closed its standard input or output"
        return f"ended with signal {-code}" if code < 0 else f"ended with exit code {code}"


def _end(child: "subprocess.Popen[bytes]") -> None:
    """Kill a process and all of its session."""
    for pipe in (child.stdin, child.stdout):
        if pipe is not None:
            pipe.close()
    try:
        os.killpg(child.pid, signal.SIGKILL)
    except (ProcessLookupError, PermissionError):
        child.kill()
    child.wait()


class ForeignEstimator:
    """The estimator: a process for each hand of each twin, started at its first step.

    The process keeps the state, so its steps cannot be repeated: it is for twins, and not for runs. ``is_waited_for``
    says that its steps are timed by the clock, as its own processor time is not the worker's.
    """

    is_waited_for: Final = True

    def __init__(self, model: ArmModel) -> None:
        self._process: Process | None = None
        self._about = json.loads(os.environ[VARIABLE])
        self._model = model

    def initial(self) -> tuple[int, int]:
        """Return how many samples of arm and command the process was told: none."""
        return 0, 0

    def step(self, state: tuple[int, int], playout: Playout, now_ns: int) -> tuple[tuple[int, int], Estimate]:
        """Return the process's estimate; raises `ForeignFault` for its first fault, and from then on."""
        key = json.dumps(self._about)
        if key in _FAILED:
            raise ForeignFault(_FAILED[key])
        try:
            if self._process is None:
                self._process = self._begun(playout.rate_hz)
            message = {
                "type": "step",
                "now_ns": now_ns,
                "newest": playout.arm.newest,
                "arm": _new(playout.arm, state[0]),
                "command": _new(playout.command, state[1]),
            }
            found = estimate_of(self._process.ask(message, STEP_S))
        except ForeignFault as fault:
            _FAILED[key] = str(fault)
            if self._process is not None:
                self._process.close()
            raise
        return (playout.arm.n_added, playout.command.n_added), found

    def _begun(self, rate_hz: int) -> Process:
        process = Process(self._about["command"])
        message = {
            "type": "begin",
            "version": 1,
            "rate_hz": rate_hz,
            "hand": self._model.hand,
            "training": self._about["training"],
        }
        _begin(process, message)
        return process


def _begin(process: Process, message: Mapping[str, Any]) -> None:
    answer = process.ask(message, BEGIN_S)
    if answer != _FIRST_ANSWER:
        process.close()
        raise ForeignFault(f"must answer {json.dumps(_FIRST_ANSWER)} first (got {_short(answer)})")


def estimate_of(answer: Any) -> Estimate:
    """Return the estimate of a parsed answer; raises `ForeignFault`. Oracle: `VECTORS`."""
    if not isinstance(answer, dict) or not {"position_m"} <= set(answer) <= {"position_m", "covariance_m2"}:
        raise ForeignFault(f"must answer position_m, and covariance_m2 or not (got {_short(answer)})")
    position, covariance = answer["position_m"], answer.get("covariance_m2")
    if position is None:
        return Estimate(None)
    rows = None if covariance is None else _numbers(covariance, (3, 3), "covariance_m2")
    return Estimate(_numbers(position, (3,), "position_m"), rows)


def _numbers(value: Any, shape: tuple[int, ...], what: str) -> Any:
    try:
        found = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.shape != shape or not np.isfinite(found).all():
        raise ForeignFault(f"{what} must be {' x '.join(map(str, shape))} finite numbers (got {_short(value)})")
    return found


def _new(buffer: SourceBuffer, n_added: int) -> list[list[float]]:
    """Return the samples that arrived since, in order of arrival: index, x, y, z in m."""
    found = []
    for index in buffer.added_since(n_added):
        position_m = buffer.get(index)
        if position_m is not None:
            found.append([index, *position_m.tolist()])
    return found


def _short(value: Any) -> str:
    return json.dumps(value)[:80]
