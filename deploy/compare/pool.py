"""Process pool of a comparison: trainings first, each cell as soon as its models exist.

A process that dies ends the pool, and with it all units that were submitted, up to three for each process. A new pool
repeats these one at a time, so that the one that ends its process again is known, and fails alone.
"""

import contextlib
import multiprocessing
import os
import signal
import traceback
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field, replace
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
_AHEAD: Final = 3
"""Units that are submitted for each process: it must not wait for the next."""
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
        _Scheduler(plan, store, n_jobs or os.cpu_count() or 1, outcome, progress).run(missing)
    return outcome


@contextlib.contextmanager
def _pool(n_jobs: int) -> Iterator[ProcessPoolExecutor]:
    """Return single-threaded worker processes; an exception terminates them."""
    before = set(multiprocessing.active_children())
    saved = {name: os.environ.get(name) for name in _ONE_THREAD}
    os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # read when the workers load numpy
    pool = ProcessPoolExecutor(n_jobs, mp_context=multiprocessing.get_context("spawn"), initializer=_leave_interrupts)
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


Unit = Training | Cell


@dataclass
class _Scheduler:
    """The units to compute: ``ready`` ones, cells that await the models of a training, and ``suspects``.

    Suspects were submitted when a process died.
    """

    plan: Plan
    store: Store
    n_jobs: int
    outcome: Outcome
    progress: PhaseProgress
    ready: deque[Unit] = field(default_factory=deque)
    waiting: dict[str, list[Cell]] = field(default_factory=dict)
    suspects: deque[Unit] = field(default_factory=deque)

    def run(self, missing: list[Cell]) -> None:
        """Compute all units, in as many pools as it takes."""
        # Cells of one trial and seed follow each other, as workers keep what these share.
        for cell in sorted(missing, key=lambda cell: (cell.training or "", cell.trial, cell.scenario.seed)):
            if cell.training is None or cell.training in self.outcome.trainings:
                self.ready.append(cell)
            else:
                self.waiting.setdefault(cell.training, []).append(cell)
        self.ready.extendleft(self.plan.trainings[digest] for digest in reversed(self.waiting))
        if self.waiting:
            self.progress.total(_TRAININGS, len(self.waiting))
        self.progress.total(_CELLS, len(self.plan.cells), self.outcome.n_resumed)
        while self.ready or self.suspects:
            with _pool(1 if self.suspects else self.n_jobs) as pool:
                self._drain(pool)

    def _drain(self, pool: ProcessPoolExecutor) -> None:
        """Compute units until none is left, or a process dies; suspects alone, one at a time."""
        alone = bool(self.suspects)
        units, most = (self.suspects, 1) if alone else (self.ready, _AHEAD * self.n_jobs)
        pending: dict[Future[Any], Unit] = {}
        while units or pending:
            # A few units ahead of the workers; another comparison may have stored a cell meanwhile.
            while units and len(pending) < most:
                unit = units.popleft()
                if isinstance(unit, Cell) and (known := self.store.cell(unit.digest)) is not None:
                    self.outcome.cells[unit.digest] = known
                    self.progress.advance(_CELLS)
                    continue
                try:
                    pending[self._submitted(pool, unit)] = unit
                except BrokenProcessPool:  # between two results
                    units.appendleft(unit)
                    self.suspects.extend(pending.values())
                    return
            done, _ = wait(pending, _POLL_S, return_when=FIRST_COMPLETED)
            self.progress.wait()
            for future in sorted(done, key=_is_lost):
                unit = pending.pop(future)
                result = _result(future, unit.label)
                if result is not None:
                    self._computed(unit, result)
                elif alone:
                    self._computed(unit, Failure(unit.label, "its process died, twice (out of memory?)"))
                    return
                else:
                    self.suspects.extend([unit, *pending.values()])
                    return

    def _submitted(self, pool: ProcessPoolExecutor, unit: Unit) -> Future[Any]:
        if isinstance(unit, Training):
            return pool.submit(_guarded, train, unit, self.store.model_file(unit.digest))
        model_file: Path | None = None if unit.training is None else self.store.model_file(unit.training)
        return pool.submit(_guarded, run_cell, unit, model_file)

    def _computed(self, unit: Unit, result: dict[str, Any] | Failure) -> None:
        """Store a result, or note the failure; the cells of a training become ready, or fail with it."""
        if isinstance(unit, Cell):
            if isinstance(result, Failure):
                self.outcome.failures.append(result)
            else:
                self.store.save_cell(unit.digest, result)
                self.outcome.cells[unit.digest] = result
            self.progress.advance(_CELLS)
            return
        cells = self.waiting.pop(unit.digest)
        self.progress.advance(_TRAININGS)
        if isinstance(result, Failure):
            self.outcome.failures.append(replace(result, label=f"training on {unit.label}"))
            self.progress.advance(_CELLS, len(cells))
            return
        self.store.save_training(unit.digest, result)
        self.outcome.trainings[unit.digest] = result
        self.ready.extend(cells)


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


def _is_lost(future: Future[Any]) -> bool:
    return isinstance(future.exception(), BrokenProcessPool)


def _result(future: Future[Any], label: str) -> dict[str, Any] | Failure | None:
    """Return a unit's result or failure; None: its process, or another of the pool, died."""
    try:
        result = future.result()
    except BrokenProcessPool:
        return None
    if isinstance(result, Failure):
        if result.ends_all:
            raise InputError([Fault("", "", text) for text in result.ends_all])
        return Failure(label, result.reason, result.trace)
    assert isinstance(result, dict)
    return result
