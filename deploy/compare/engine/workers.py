"""Workers: they take units of work and give results. What a worker computes is the same everywhere."""

import multiprocessing
import os
import signal
import sys
import threading
import traceback
from collections import deque
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, Self

from tis.common.errors import Fault, InputError, TisError
from tis.deploy.compare.cells.cell import Cell, Training, run_cell, train
from tis.patient_side.estimators.guarded import UnusableEstimatorError

AHEAD: Final = 3
"""Units that are submitted for each worker: it must not wait for the next."""
_POLL_S: Final = 1.0

Unit = Training | Cell


@dataclass(frozen=True)
class Computed:
    """Result of a unit as plain JSON, and the file of the models that a training identified."""

    result: dict[str, Any]
    models: bytes | None = None


@dataclass(frozen=True)
class Failure:
    """Failed unit of work: label, reason, and the traceback unless the input was at fault.

    ``ends_all`` holds the faults of an unusable user-defined estimator, which all other units would share.
    """

    label: str
    reason: str
    trace: str | None = None
    ends_all: tuple[str, ...] = ()


Result = Computed | Failure


class Workers(Protocol):
    """Workers of an engine, from entering their context on; leaving it by an exception ends what they compute.

    They serve several plans, one after the other.
    """

    def __enter__(self) -> Self: ...

    def __exit__(self, kind: type[BaseException] | None, /, *_: object) -> None: ...

    def has_room(self) -> bool:
        """Tell whether another unit should be submitted now."""
        ...

    def submit(self, unit: Unit, model_file: Path | None) -> None:
        """Take a unit; ``model_file`` holds the models of a cell's training."""
        ...

    def completed(self) -> list[tuple[Unit, Result]]:
        """Return what was completed since, after waiting for it for a second at most; each unit once."""
        ...


def perform(unit: Unit, model_file: Path | None) -> Result:
    """Compute a unit, in a worker; a failure is a value, as not every exception can be pickled."""
    try:
        if isinstance(unit, Training):
            return Computed(*train(unit))
        return Computed(run_cell(unit, model_file))
    except UnusableEstimatorError as error:
        return Failure(unit.label, "", ends_all=tuple(map(str, error.faults)))
    except TisError as error:
        return Failure(unit.label, "; ".join(str(fault) for fault in error.faults))
    except Exception as error:
        return Failure(unit.label, f"{type(error).__name__}: {error}", traceback.format_exc())


def first_done(pending: dict[Future[Any], Any], is_last: Callable[[Future[Any]], bool]) -> list[Future[Any]]:
    """Return the futures that are done, after waiting for one of them; those that ``is_last`` holds for come last."""
    done, _ = wait(pending, _POLL_S, return_when=FIRST_COMPLETED)
    return sorted(done, key=is_last)


# Workers that are processes of this machine.


_ONE_THREAD: Final = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")

_UNGUARDED: Final = 101
"""Exit code of a worker whose client is a script without a guard: each worker imports the script first."""

Submitted = tuple[Unit, Path | None]


class Processes:
    """Single-threaded worker processes, ``n_jobs`` or one per core when None; the first unit starts them.

    `completed` raises `InputError` in a script that computes where it is imported, as each process imports it.
    """

    def __init__(self, n_jobs: int | None = None) -> None:
        self._n_jobs = n_jobs or os.cpu_count() or 1
        self._pool: ProcessPoolExecutor | None = None
        self._pending: dict[Future[Any], Submitted] = {}
        self._suspects: deque[Submitted] = deque()
        self._is_alone = False
        self._environment: dict[str, str | None] = {}
        self._others: set[Any] = set()
        self._started: set[Any] = set()
        self._on_term: Any = None

    def __enter__(self) -> Self:
        if getattr(multiprocessing.current_process(), "_inheriting", False):  # the script is being imported
            sys.exit(_UNGUARDED)
        self._others = set(multiprocessing.active_children())
        self._environment = {name: os.environ.get(name) for name in _ONE_THREAD}
        os.environ.update(dict.fromkeys(_ONE_THREAD, "1"))  # read when the workers load numpy
        if threading.current_thread() is threading.main_thread():
            self._on_term = signal.signal(signal.SIGTERM, _exit_on_term)
        return self

    def __exit__(self, kind: type[BaseException] | None, /, *_: object) -> None:
        if kind is not None:
            for child in set(multiprocessing.active_children()) - self._others:
                child.terminate()
        self._end_pool()
        if self._on_term is not None:
            signal.signal(signal.SIGTERM, self._on_term)
        for name, value in self._environment.items():
            os.environ.pop(name, None) if value is None else os.environ.update({name: value})

    def has_room(self) -> bool:
        """Tell whether another unit should be submitted; not before all suspects are repeated."""
        return not self._suspects and not self._is_alone and len(self._pending) < AHEAD * self._n_jobs

    def submit(self, unit: Unit, model_file: Path | None) -> None:
        """Take a unit; it is a suspect where the pool broke after the last result."""
        try:
            self._start(unit, model_file)
        except BrokenProcessPool:
            self._suspect((unit, model_file))

    def completed(self) -> list[tuple[Unit, Result]]:
        """Return what was completed; see `Workers`."""
        if self._suspects and not self._pending:
            self._end_pool()
            self._is_alone = True
            self._start(*self._suspects.popleft())
        results: list[tuple[Unit, Result]] = []
        for future in first_done(self._pending, _is_lost):
            submitted = self._pending.pop(future)
            unit, _ = submitted
            if not _is_lost(future):
                results.append((unit, future.result()))
            elif any(child.exitcode == _UNGUARDED for child in self._started):
                rule = 'must be called below if __name__ == "__main__": in a script, which its processes import'
                raise InputError(Fault("compare", "", rule))
            elif self._is_alone:
                results.append((unit, Failure(unit.label, "its process died, twice (out of memory?)")))
                self._end_pool()
            else:
                self._suspect(submitted)
                break
        if self._is_alone and not self._suspects and not self._pending:
            self._end_pool()
            self._is_alone = False
        return results

    def _start(self, unit: Unit, model_file: Path | None) -> None:
        if self._pool is None:
            n_jobs = 1 if self._is_alone else self._n_jobs
            context = multiprocessing.get_context("spawn")
            self._pool = ProcessPoolExecutor(n_jobs, mp_context=context, initializer=begin_worker)
        self._pending[self._pool.submit(perform, unit, model_file)] = unit, model_file
        self._started |= set(multiprocessing.active_children()) - self._others

    def _suspect(self, submitted: Submitted) -> None:
        """Suspect a unit and all others that were submitted with it, as a process of the pool died."""
        self._suspects.extend([submitted, *self._pending.values()])
        self._pending.clear()

    def _end_pool(self) -> None:
        if self._pool is not None:
            self._pool.shutdown(wait=True, cancel_futures=True)
            self._pool = None


def _exit_on_term(number: int, _: object) -> None:
    """Leave as after Ctrl-C: killed at once, this process would leave the semaphores of its queue behind."""
    sys.exit(128 + number)


def begin_worker() -> None:
    """Prepare a worker: it ignores Ctrl-C, which reaches every process of the terminal, and outlives no client.

    A client that is killed cannot end its workers, and their siblings keep the queue open that they wait at.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_client, daemon=True).start()


def _end_with_client() -> None:
    client = multiprocessing.parent_process()
    assert client is not None
    client.join()
    os._exit(1)


def _is_lost(future: Future[Any]) -> bool:
    return isinstance(future.exception(), BrokenProcessPool)
