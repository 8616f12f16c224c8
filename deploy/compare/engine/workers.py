"""Workers: they take units of work and give results. What a worker computes is the same everywhere."""

import traceback
from collections.abc import Callable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Protocol, Self

from tis.common.errors import TisError
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

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
