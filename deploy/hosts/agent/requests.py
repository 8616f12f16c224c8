"""Execution of one request on a host, and the faults of what a side would read there."""

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import BinaryIO, Final

from tis.common.channels import Side
from tis.common.errors import EXIT_OK, DataError, Fault, TisError
from tis.common.runtime.credentials import credentials
from tis.common.runtime.recordings import check_recording, located
from tis.common.runtime.scenario_files import load_traces
from tis.common.scenario import Scenario
from tis.common.scenario.identification import is_model_file
from tis.deploy.hosts.protocol import (
    MAX_REQUEST_BYTES,
    CheckAnswer,
    CheckRequest,
    ListAnswer,
    ListRequest,
    ReadRequest,
    RunRequest,
    RunsAnswer,
    RunsRequest,
    line_of,
    request_of,
)
from tis.deploy.hosts.transfer.offered_logs import offered_logs, read_range
from tis.deploy.shell.guard import version_text
from tis.patient_side.models import own_estimators, read_models
from tis.patient_side.plant.extra import check_plant


def input_faults(side: Side, scenario: Scenario) -> list[Fault]:
    """Return the faults of the current folder and of the files that a side needs of a scenario.

    Certificates and passwords, recordings, model, traces and own estimators, each only where this side reads it.
    """
    found = _unwritable(Path.cwd())
    steps: list[Callable[[], object]] = [lambda: credentials(scenario.security, side)]
    if side == "netem":
        steps.append(lambda: load_traces(scenario.network))
    else:
        steps.append(lambda: check_recording(located(scenario)))
    if side == "patient":
        identification = scenario.identification
        steps.append(lambda: identification.check_for_live_runs(scenario.estimators))
        steps.append(lambda: own_estimators(scenario))
        steps.append(lambda: check_plant(scenario))
        if is_model_file(scenario.identification.train):
            steps.append(lambda: read_models(Path(scenario.identification.train)))
    for step in steps:
        try:
            step()
        except TisError as error:
            found += error.faults
    return found


def _unwritable(folder: Path) -> list[Fault]:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return []
    except OSError as error:
        return [Fault(str(folder), "", f"cannot be written: {error.strerror or os.strerror(error.errno or 0)}")]


_RUNS: Final = "runs"


def obey(source: BinaryIO, out: BinaryIO) -> int:
    """Read a request from ``source`` (unbuffered), execute it, and answer on ``out``; raises `TisError`."""
    request = request_of(_line(source))
    if isinstance(request, CheckRequest):
        found = tuple(str(fault)[:2000] for fault in _faults(request))[:500]
        out.write(line_of(CheckAnswer(version=version_text(), faults=found)))
        return EXIT_OK
    _enter(request.folder)
    run_dir = _run_dir(request.side, getattr(request, "run", ""))
    if isinstance(request, RunRequest):
        from tis.deploy.hosts.agent.side_run import run_side

        return run_side(request, run_dir, source.fileno(), out.fileno())
    if isinstance(request, RunsRequest):
        out.write(line_of(RunsAnswer(runs=tuple(_runs(request.side)))))
    elif isinstance(request, ListRequest):
        out.write(line_of(ListAnswer(logs=tuple(offered_logs(run_dir, request.parts)))))
    elif isinstance(request, ReadRequest):
        for block in read_range(run_dir, request.name, request.begin, request.end):
            out.write(block)
    return EXIT_OK


def standard_streams() -> tuple[BinaryIO, BinaryIO]:
    """Return this process's input, unbuffered, and output, for bytes."""
    return os.fdopen(sys.stdin.fileno(), "rb", buffering=0, closefd=False), sys.stdout.buffer


def _line(source: BinaryIO) -> bytes:
    """Return the first line, not more: what follows belongs to the side that it starts."""
    line = bytearray()
    while not line.endswith(b"\n") and len(line) <= MAX_REQUEST_BYTES and (one := source.read(1)):
        line += one
    return bytes(line)


def _enter(folder: str) -> None:
    try:
        os.chdir(Path(folder).expanduser())
    except (OSError, RuntimeError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise DataError(Fault(folder, "", f"working folder cannot be entered: {reason}")) from None


def _faults(request: CheckRequest) -> list[Fault]:
    found: list[Fault] = []

    def note(step: Callable[[], None]) -> None:
        try:
            step()
        except TisError as error:
            found.extend(error.faults)

    def inputs() -> None:
        # Late, as in `obey`: what a scenario needs takes a second to import, and most requests do not.
        from tis.common.scenario import reading
        from tis.deploy.hosts.agent.requests import input_faults

        scenario = reading.build_scenario(reading.parse_yaml(request.scenario, "scenario"), "scenario")
        found.extend(input_faults(request.side, scenario))

    note(lambda: _enter(request.folder))
    if not found:
        note(inputs)
    return found


def _run_dir(side: Side, run: str) -> Path:
    """Return a run's folder on this host; two sides on one host have one each."""
    return Path(_RUNS, f"{run}_on_{side}").absolute()


def _runs(side: Side) -> list[str]:
    """Return the names of the runs of which this host has the side's folder, the oldest first."""
    ending = f"_on_{side}"
    found = [path for path in Path(_RUNS).glob(f"*{ending}") if path.is_dir()]
    return [path.name.removesuffix(ending) for path in sorted(found, key=lambda path: path.stat().st_mtime)]
