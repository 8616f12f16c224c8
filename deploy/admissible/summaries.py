"""Summaries of logged twins, for limits on figures that cells do not keep; stored by digest, as cells are."""

import json
import multiprocessing
import signal
from collections.abc import Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from functools import cache
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from common.channels import Side
from common.errors import DataError, Fault, TisError
from common.runtime.recordings import load_recording
from deploy.admissible.figures import flat
from deploy.compare.cells.cell import Cell, with_models
from deploy.compare.cells.digests import content_digest, value_digest
from deploy.compare.cells.store import Store
from deploy.logs.read.load import RunLogs
from deploy.logs.read.memory import MemoryLog
from deploy.report.summary import build_summary
from deploy.run.twin import build_sides, drive
from deploy.shell import run_dir as folder
from deploy.shell.progress import PhaseProgress

Flat = Mapping[str, float | None]
_DEPLOY: Final = Path(__file__).resolve().parents[1]
_DECIDING: Final = ("report", "logs")
_POLL_S: Final = 1.0
_AHEAD: Final = 2
_PHASE: Final = "summaries"


class Summaries:
    """Processes that run logged twins, ``n_jobs`` of them; the first twin starts them, and they serve all plans."""

    def __init__(self, store: Store, n_jobs: int) -> None:
        self._store = store
        self._n_jobs = n_jobs
        self._pool: ProcessPoolExecutor | None = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)

    def of(self, cells: Sequence[Cell], progress: PhaseProgress) -> dict[str, Flat]:
        """Return the flat summary of each cell's twin by the cell's digest, computed unless it is stored.

        Models must be in the store. Raises `DataError` with the twins that failed.
        """
        known: dict[str, Flat] = {}
        missing: list[Cell] = []
        for cell in cells:
            found = _read(self._file(cell))
            if found is None:
                missing.append(cell)
            else:
                known[cell.digest] = found
        progress.total(_PHASE, len(cells), len(known))
        return known | self._computed(missing, progress)

    def _computed(self, missing: Sequence[Cell], progress: PhaseProgress) -> dict[str, Flat]:
        found: dict[str, Flat] = {}
        faults: list[Fault] = []
        left = list(reversed(missing))
        pending: dict[Future[Any], Cell] = {}
        while left or pending:
            while left and len(pending) < _AHEAD * self._n_jobs:
                cell = left.pop()
                pending[self._started().submit(summary_of_twin, cell, self._model_file(cell))] = cell
            done, _ = wait(pending, _POLL_S, return_when=FIRST_COMPLETED)
            for future in done:
                cell = pending.pop(future)
                try:
                    found[cell.digest] = future.result()
                except TisError as error:
                    faults += [Fault(cell.label, "", str(fault)) for fault in error.faults]
                else:
                    folder.write(self._file(cell), json.dumps(found[cell.digest]))
                progress.advance(_PHASE)
            progress.wait()
        if faults:
            raise DataError(faults)
        return found

    def _started(self) -> ProcessPoolExecutor:
        if self._pool is None:
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(self._n_jobs, mp_context=context, initializer=_leave_interrupts)
        return self._pool

    def _model_file(self, cell: Cell) -> Path | None:
        return None if cell.training is None else self._store.model_file(cell.training)

    def _file(self, cell: Cell) -> Path:
        path = self._store.path / "summaries"
        path.mkdir(exist_ok=True)
        return path / f"{value_digest([cell.digest, _summary_digest()])}.json"


def summary_of_twin(cell: Cell, model_file: Path | None) -> dict[str, float | None]:
    """Run a cell's twin with logs in memory; return the numbers of its summary. Raises `DataError`."""
    scenario = cell.scenario if model_file is None else with_models(cell.scenario, model_file)
    nodes, models, _ = build_sides(scenario, recording=load_recording(scenario))
    memories: dict[Side, MemoryLog] = {side: MemoryLog(side) for side in nodes}
    drive(scenario, nodes, memories)
    logs = RunLogs(Path(), {side: memory.log for side, memory in memories.items()})
    return flat(build_summary(logs, scenario, models, "twin", None, ""))


def _leave_interrupts() -> None:
    """Ignore Ctrl-C, which reaches every process of the terminal; the parent handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _read(file: Path) -> Flat | None:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return content if isinstance(content, dict) else None


@cache
def _summary_digest() -> str:
    """Return a digest of the code that turns logs into a summary; the twin's own is part of the cell's."""
    files = sorted(file for name in _DECIDING for file in (_DEPLOY / name).rglob("*.py"))
    return value_digest([content_digest(file.read_bytes()) for file in files])
