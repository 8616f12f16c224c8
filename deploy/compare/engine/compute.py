"""Computation of a plan: trainings first, each cell as soon as its models exist."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from tis.common.errors import DataError, Fault, InputError
from tis.deploy.compare.cells.cell import Cell, Training
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.cluster import Cluster
from tis.deploy.compare.engine.workers import Computed, Failure, Processes, Result, Unit, Workers
from tis.deploy.shell.progress import PhaseProgress

# Choice of the workers of a comparison.


def workers_of(n_jobs: int | None, scheduler: str | None, notify: Callable[[str], None]) -> Workers:
    """Return the workers of a cluster where a ``scheduler`` is named, otherwise processes; raises `InputError`.

    ``notify`` prints notices on the cluster.
    """
    if n_jobs is not None and scheduler is not None:
        rule = "must be given without --scheduler: the number of Dask's workers decides"
        raise InputError(Fault("--jobs", "", rule, n_jobs))
    if n_jobs is not None and (not isinstance(n_jobs, int) or n_jobs < 1):
        raise InputError(Fault("--jobs", "", "must be a whole number of at least 1", n_jobs))
    if scheduler is None:
        return Processes(n_jobs)
    return Cluster(scheduler, notify)


_TRAININGS: Final = "models identified"
_CELLS: Final = "twins"


@dataclass
class Outcome:
    """Results by digest, and failures."""

    trainings: dict[str, dict[str, Any]] = field(default_factory=dict)
    cells: dict[str, dict[str, Any]] = field(default_factory=dict)
    failures: list[Failure] = field(default_factory=list)
    n_resumed: int = 0

    def without_answer(self) -> dict[str, str]:
        """Return the user-defined estimators that failed at every scored tick of a hand in a twin: no score."""
        found: dict[str, str] = {}
        for result in self.cells.values():
            for name, about in result.get("own_faults", {}).items():
                if any(name not in hand["estimators"] for hand in result["hands"].values()):
                    where = f"{result['trial']}, seed {result['seed']}, first at {about['first']}"
                    found.setdefault(name, f"failed at every scored tick of a twin, and has no score: {where}")
        return found

    def check(self) -> None:
        """Raise `DataError` with all failures, if there are any."""
        faults = [Fault(failure.label, "", failure.reason) for failure in self.failures]
        faults += [Fault(name, "", text) for name, text in self.without_answer().items()]
        if faults:
            raise DataError(faults)


def compute(
    cells: Sequence[Cell], trainings: Mapping[str, Training], store: Store, workers: Workers, progress: PhaseProgress
) -> Outcome:
    """Compute cells that the store does not hold yet, by ``workers``, whose context is entered.

    Each result is stored immediately, so `KeyboardInterrupt` loses only the units
    in progress. An unusable user-defined estimator raises `InputError` in the same way.
    The results do not depend on the workers.
    """
    # results of earlier calls; a training without the requested times is repeated
    outcome = Outcome()
    missing = []
    for cell in cells:
        known = store.cell(cell.digest)
        if known is None:
            missing.append(cell)
        else:
            outcome.cells[cell.digest] = known
    outcome.n_resumed = len(cells) - len(missing)
    for training in trainings.values():
        known = store.training(training.digest)
        if known is not None and (known["train_s"] or not training.timed):
            outcome.trainings[training.digest] = known
    if missing:
        _Computation(trainings, store, workers, outcome, progress).run(missing)
    return outcome


@dataclass
class _Computation:
    """The units to compute: ``ready`` ones, and cells that await the models of a training."""

    trainings: Mapping[str, Training]
    store: Store
    workers: Workers
    outcome: Outcome
    progress: PhaseProgress
    ready: deque[Unit] = field(default_factory=deque)
    waiting: dict[str, list[Cell]] = field(default_factory=dict)
    n_submitted: int = 0

    def run(self, missing: list[Cell]) -> None:
        """Compute all units."""
        # Cells of one trial and seed follow each other, as workers keep what these share.
        for cell in sorted(missing, key=lambda cell: (cell.training or "", cell.trial, cell.scenario.seed)):
            if cell.training is None or cell.training in self.outcome.trainings:
                self.ready.append(cell)
            else:
                self.waiting.setdefault(cell.training, []).append(cell)
        self.ready.extendleft(self.trainings[digest] for digest in reversed(self.waiting))
        if self.waiting:
            self.progress.total(_TRAININGS, len(self.waiting))
        self.progress.total(_CELLS, len(missing) + self.outcome.n_resumed, self.outcome.n_resumed)
        while self.ready or self.n_submitted:
            while self.ready and self.workers.has_room():
                self._submit(self.ready.popleft())
            for unit, result in self.workers.completed():
                self.n_submitted -= 1
                self._computed(unit, result)
            self.progress.wait()

    def _submit(self, unit: Unit) -> None:
        """Submit a unit, unless another comparison has stored its result meanwhile."""
        if isinstance(unit, Cell) and (known := self.store.cell(unit.digest)) is not None:
            self.outcome.cells[unit.digest] = known
            self.progress.advance(_CELLS)
            return
        training = unit.training if isinstance(unit, Cell) else None
        model_file: Path | None = None if training is None else self.store.model_file(training)
        self.workers.submit(unit, model_file)
        self.n_submitted += 1

    def _computed(self, unit: Unit, result: Result) -> None:
        """Store a result, or note the failure; the cells of a training become ready, or fail with it."""
        if isinstance(result, Failure) and result.ends_all:
            raise InputError([Fault("", "", text) for text in result.ends_all])
        if isinstance(unit, Cell):
            if isinstance(result, Failure):
                self.outcome.failures.append(result)
            else:
                self.store.save_cell(unit.digest, result.result)
                self.outcome.cells[unit.digest] = result.result
            self.progress.advance(_CELLS)
        else:
            self._trained(unit, result)

    def _trained(self, training: Training, result: Result) -> None:
        cells = self.waiting.pop(training.digest)
        self.progress.advance(_TRAININGS)
        if isinstance(result, Failure):
            self.outcome.failures.append(replace(result, label=f"training on {result.label}"))
            self.progress.advance(_CELLS, len(cells))
            return
        assert isinstance(result, Computed)
        assert result.models is not None
        self.store.save_training(training.digest, result.result, result.models)
        self.outcome.trainings[training.digest] = result.result
        self.ready.extend(cells)
