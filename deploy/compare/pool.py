"""Process pool of a comparison: trainings first, each cell as soon as its models exist."""

import contextlib
import multiprocessing
import os
import signal
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from common.errors import Fault, InputError, TisError
from deploy.compare.cells.cell import Cell, Training, run_cell, train
from deploy.compare.cells.store import Store
from deploy.compare.plan import Plan
from deploy.shell.progress import PhaseProgress
from patient_side.estimators.guarded import UnusableEstimatorError

_ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
_POLL_S: Final = 1.0
_TRAININGS: Final = "models identified"
_CELLS: Final = "twins"


@dataclass(frozen=True)
class Failure:
    """Failed unit of work: label, reason, and the traceback unless the input was at fault.

    ``ends_all`` holds the faults of an unusable user-defined estimator, which all other units would share.
    """

    label: str
    reason: str
    trace: str | None = None
    ends_all: tuple[str, ...] = ()


@dataclass
class Outcome:
    """Results by digest, and failures."""

    trainings: dict[str, dict[str, Any]] = field(default_factory=dict)
    cells: dict[str, dict[str, Any]] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)
    n_resumed: int = 0


def compute(plan: Plan, store: Store, n_jobs: int | None, progress: PhaseProgress) -> Outcome:
    """Compute what the store does not hold yet, in ``n_jobs`` processes (one per core when None).

    Each result is stored immediately, so `KeyboardInterrupt` loses only the units
    in progress, whose processes are ended. An unusable user-defined estimator raises `InputError` in the same way.
    The results do not depend on the number of processes.
    """
    # results of earlier calls; a training without the requested times is repeated
    outcome = Outcome()
    missing = []
    for cell in plan.cells:
        known = store.cell(cell.digest)
        if known is None:
            missing.append(cell)
        else:
            outcome.cells[cell.digest] = known
    outcome.n_resumed = len(plan.cells) - len(missing)
    for training in plan.trainings.values():
        known = store.training(training.digest)
        if known is not None and (known["train_s"] or not training.timed):
            outcome.trainings[training.digest] = known
    if missing:
        with _pool(n_jobs) as pool:
            _Scheduler(plan, store, pool, outcome, progress).run(missing)
    return outcome


@contextlib.contextmanager
def _pool(n_jobs: int | None) -> Iterator[ProcessPoolExecutor]:
    """Return single-threaded worker processes; an exception terminates them."""
    before = set(multiprocessing.active_children())
    saved = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # read when the workers load numpy
    pool = ProcessPoolExecutor(
        n_jobs or os.cpu_count(), mp_context=multiprocessing.get_context("spawn"), initializer=_leave_interrupts
    )
    try:
        yield pool
    except BaseException:
        for child in set(multiprocessing.active_children()) - before:
            child.terminate()
        pool.shutdown(wait=True, cancel_futures=True)
        raise
    else:
        pool.shutdown(wait=True)
    finally:
        for name, value in saved.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})


def _leave_interrupts() -> None:
    """Ignore Ctrl-C, which reaches every process of the terminal; the parent handles it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


@dataclass
class _Scheduler:
    plan: Plan
    store: Store
    pool: ProcessPoolExecutor
    outcome: Outcome
    progress: PhaseProgress
    pending: dict[Future[Any], Training | Cell] = field(default_factory=dict)

    def run(self, missing: list[Cell]) -> None:
        """Submit trainings and the cells that need none; the other cells follow as models arrive."""
        waiting: dict[str, list[Cell]] = {}
        for cell in missing:
            if cell.training is None or cell.training in self.outcome.trainings:
                self._submit_cell(cell)
            else:
                waiting.setdefault(cell.training, []).append(cell)
        if waiting:
            self.progress.total(_TRAININGS, len(waiting))
        self.progress.total(_CELLS, len(self.plan.cells))
        self.progress.advance(_CELLS, self.outcome.n_resumed)
        for digest in waiting:
            training = self.plan.trainings[digest]
            self.pending[self.pool.submit(_guarded, train, training, self.store.model_file(digest))] = training
        while self.pending:
            done, _ = wait(self.pending, _POLL_S, return_when=FIRST_COMPLETED)
            self.progress.wait()
            for future in done:
                unit = self.pending.pop(future)
                if isinstance(unit, Training):
                    self._trained(unit, _result(future, f"training on {unit.label}"), waiting.pop(unit.digest))
                else:
                    self._finished(unit, _result(future, unit.label))

    def _submit_cell(self, cell: Cell) -> None:
        model_file: Path | None = None if cell.training is None else self.store.model_file(cell.training)
        # A broken pool refuses work: the cell then fails like those whose process died.
        try:
            future = self.pool.submit(_guarded, run_cell, cell, model_file)
        except BrokenProcessPool:
            future = Future()
            future.set_exception(BrokenProcessPool())
        self.pending[future] = cell

    def _trained(self, training: Training, result: dict[str, Any] | Failure, cells: list[Cell]) -> None:
        if isinstance(result, Failure):
            self.outcome.failures.append(result)
            self.progress.advance(_TRAININGS)
            self.progress.advance(_CELLS, len(cells))
            return
        self.store.save_training(training.digest, result)
        self.outcome.trainings[training.digest] = result
        self.progress.advance(_TRAININGS)
        for cell in cells:
            self._submit_cell(cell)

    def _finished(self, cell: Cell, result: dict[str, Any] | Failure) -> None:
        if isinstance(result, Failure):
            self.outcome.failures.append(result)
        else:
            self.store.save_cell(cell.digest, result)
            self.outcome.cells[cell.digest] = result
        self.progress.advance(_CELLS)


def _guarded(work: Callable[..., dict[str, Any]], *arguments: Any) -> dict[str, Any] | Failure:
    """Return the result or a failure: not every exception can be pickled."""
    try:
        return work(*arguments)
    except UnusableEstimatorError as error:
        return Failure("", "", ends_all=tuple(map(str, error.faults)))
    except TisError as error:
        return Failure("", "; ".join(str(fault) for fault in error.faults))
    except Exception as error:
        return Failure("", f"{type(error).__name__}: {error}", traceback.format_exc())


def _result(future: Future[Any], label: str) -> dict[str, Any] | Failure:
    try:
        result = future.result()
    except BrokenProcessPool:
        return Failure(label, "its process died (out of memory?)")
    if isinstance(result, Failure):
        if result.ends_all:
            raise InputError([Fault("", "", text) for text in result.ends_all])
        return Failure(label, result.reason, result.trace)
    assert isinstance(result, dict)
    return result
