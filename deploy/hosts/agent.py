"""The part that runs on each host, `tis host`: it obeys one request of `tis up` or `tis collect`.

What checks and runs a side is loaded where a request asks for it: it takes longer than all else, and most requests,
one for each piece of a log, have no use for it.
"""

import os
import sys
from pathlib import Path
from typing import BinaryIO, Final

from tis.common.channels import Side
from tis.common.errors import EXIT_OK, DataError, Fault, TisError
from tis.deploy.hosts.log_offer import offered_logs, read_range
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
from tis.deploy.shell.guard import version_text

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
        from tis.deploy.hosts.hosted_side import run_side

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
    from tis.deploy.hosts.input_faults import input_faults

    try:
        _enter(request.folder)
    except TisError as error:
        return list(error.faults)
    return input_faults(request.side, request.scenario)


def _run_dir(side: Side, run: str) -> Path:
    """Return a run's folder on this host; two sides on one host have one each."""
    return Path(_RUNS, f"{run}_on_{side}").absolute()


def _runs(side: Side) -> list[str]:
    """Return the names of the runs of which this host has the side's folder, the oldest first."""
    ending = f"_on_{side}"
    found = [path for path in Path(_RUNS).glob(f"*{ending}") if path.is_dir()]
    return [path.name.removesuffix(ending) for path in sorted(found, key=lambda path: path.stat().st_mtime)]
