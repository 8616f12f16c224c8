"""Networks judged by the criterion: twins of each one over all persons and seeds, computed or read from the store."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf
from typing import Any, NamedTuple

from tis.common.errors import Fault, InputError
from tis.common.sources.table_columns import in_few
from tis.deploy.compare.cells.cell import Cell
from tis.deploy.compare.cells.identity import summarised
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.engine.compute import Outcome, compute
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.grid import Sweep
from tis.deploy.compare.plan import Plan, Request, make_plan
from tis.deploy.compare.results.pooled import person
from tis.deploy.run.resolve import resolve
from tis.deploy.shell.progress import PhaseProgress
from tis.deploy.studies.admissible.criterion import (
    COMMAND,
    MIN_PERSONS,
    OF_CELLS,
    Limit,
    bound_of,
    figure_of,
    name_faults,
    of_cells,
    of_summaries,
)

Flat = Mapping[str, float | None]
"""Numbers of a summary by their paths."""
Network = Mapping[str, str]
"""Values of fields of the scenario, by path."""


class Judged(NamedTuple):
    """A network's margin, bounds and figures by estimator, the latter two in the order of the limits, NaN if unknown.

    ``figures`` are those of all persons, of which the bounds are.
    ``packets_per_s`` and ``bytes_per_s`` are those of the surgeon's side; ``fault``: why the scenario refuses it.
    """

    margins: dict[str, float]
    bounds: dict[str, list[float]]
    figures: dict[str, list[float]]
    packets_per_s: float = 0.0
    bytes_per_s: float = 0.0
    fault: str | None = None


@dataclass(eq=False)
class Evaluation:
    """Twins for networks, judged for ``estimators`` by ``limits``, with counts of what it took.

    The context of ``workers``, which serve all plans, must be entered.
    """

    estimators: tuple[str, ...]
    limits: tuple[Limit, ...]
    store: Store
    workers: Workers
    progress: PhaseProgress
    n_twins: int = 0
    n_resumed: int = 0
    persons: tuple[str, ...] = ()
    synthetic: tuple[str, ...] = ()
    """Those among them whose movement no person made."""
    trained_on: str = ""
    warnings: dict[str, None] = field(default_factory=dict)
    unscored: dict[str, None] = field(default_factory=dict)
    _counted: set[str] = field(default_factory=set)
    _known: dict[tuple[Request, tuple[tuple[str, str], ...]], Judged] = field(default_factory=dict)

    @property
    def n_networks(self) -> int:
        """Number of different networks that were judged, the seeds counted apart."""
        return sum(judged.fault is None for judged in self._known.values())

    def judge(self, request: Request, networks: Sequence[Network]) -> list[Judged]:
        """Return the networks in their order; one that the scenario refuses is outside by an infinite margin.

        All of them are one plan, so that all processors work. Raises `InputError` and `DataError`.
        """
        keys = [(request, tuple(network.items())) for network in networks]
        new = {key: dict(key[1]) for key in keys if key not in self._known}
        valid = {}
        for key, network in new.items():
            fault = fault_of(request, network)
            if fault is None:
                valid[key] = network
            else:
                unknown = {name: [inf] * len(self.limits) for name in self.estimators}
                margins = dict.fromkeys(self.estimators, inf)
                self._known[key] = Judged(margins, unknown, unknown, fault=str(fault))
        if valid:
            self._known |= zip(valid, self._judged(request, list(valid.values())), strict=True)
        return [self._known[key] for key in keys]

    def check_names(self, request: Request, network: Network) -> None:
        """Raise `InputError` for limits on unknown figures, known from the summary of a single twin of a network."""
        if all(limit.name in OF_CELLS for limit in self.limits):
            return
        plan = make_plan(_with_networks(request, [network]))
        one = replace(plan, cells=plan.cells[:1])
        self._computed(one)
        (found,) = self._summaries(one).values()
        faults = name_faults(self.limits, found, plan.estimators)
        if faults:
            raise InputError(faults)

    def _judged(self, request: Request, networks: Sequence[Network]) -> list[Judged]:
        plan = make_plan(_with_networks(request, networks))
        self._note(plan)
        outcome = self._computed(plan)
        needs_logs = any(limit.name not in OF_CELLS for limit in self.limits)
        logged = self._summaries(plan) if needs_logs else {}
        cells: dict[str | None, list[Cell]] = {}
        for cell in plan.cells:
            cells.setdefault(cell.setting, []).append(cell)
        return [self._of_network(cells[point.label], outcome, logged) for point in plan.points]

    def _of_network(self, cells: Sequence[Cell], outcome: Outcome, logged: Mapping[str, Flat]) -> Judged:
        persons: dict[str, list[Cell]] = {}
        for cell in cells:
            persons.setdefault(person(cell), []).append(cell)
        results = [outcome.cells[cell.digest] for cell in cells]
        for cell, result in zip(cells, results, strict=True):
            if result["unscored"] is not None:
                self.unscored[f"{cell.label}: no tick could be scored: {result['unscored']}"] = None
        # Seeds of recorded trials are draws of the network, which all persons share.
        seeds: dict[int, list[Cell]] = {}
        for cell in cells:
            if cell.scenario.source.kind != "synthetic":
                seeds.setdefault(cell.scenario.seed, []).append(cell)

        bounds: dict[str, list[float]] = {name: [] for name in self.estimators}
        found: dict[str, list[float]] = {name: [] for name in self.estimators}
        for name, limit in product(self.estimators, self.limits):
            figures, of_seeds = (
                [_figure(limit, each, outcome.cells, logged, name) for each in parts.values()]
                for parts in (persons, seeds)
            )
            bounds[name].append(bound_of(limit, figures, of_seeds))
            found[name].append(figure_of(limit, figures))
        margins = {
            name: max(limit.margin(bound) for limit, bound in zip(self.limits, each, strict=True))
            for name, each in bounds.items()
        }
        seconds = sum(result["duration_s"] for result in results)
        packets, n_bytes = (
            sum(result["traffic"][what] for result in results) for what in ("sent_packets", "sent_bytes")
        )
        return Judged(margins, bounds, found, packets / seconds, n_bytes / seconds)

    def _note(self, plan: Plan) -> None:
        """Note who the persons are; raises `InputError` for a single one, as other trials may be too short."""
        self.persons = tuple(dict.fromkeys(person(cell) for cell in plan.cells))
        self.synthetic = tuple(dict.fromkeys(person(cell) for cell in plan.cells if cell.trial in plan.synthetic))
        self.trained_on = plan.trained_on
        self.warnings |= dict.fromkeys(str(fault) for fault in plan.refused)
        if plan.source != "synthetic" and plan.n_seeds == 1:
            self.warnings["one seed: the confidence is over people, and not over draws of the network"] = None
        check_persons(self.persons, plan.source != "synthetic")

    def _computed(self, plan: Plan) -> Outcome:
        """Return the results of all twins of a plan; raises `DataError` with those that failed."""
        # No identification is repeated for its time alone.
        untimed = {digest: replace(training, timed=False) for digest, training in plan.trainings.items()}
        outcome = compute(plan.cells, untimed, self.store, self.workers, self.progress)
        # Twins of an earlier plan of this call are counted there.
        n_again = sum(cell.digest in self._counted for cell in plan.cells)
        self._counted |= {cell.digest for cell in plan.cells}
        self.n_twins += len(plan.cells) - n_again
        self.n_resumed += outcome.n_resumed - n_again
        results = [*outcome.trainings.values(), *outcome.cells.values()]
        self.warnings |= dict.fromkeys(text for result in results for text in result.get("warnings", ()))
        outcome.check()
        return outcome

    def _summaries(self, plan: Plan) -> Mapping[str, Flat]:
        """Return the summary of a logged twin of each cell, by the cell's digest."""
        logged = {cell.digest: summarised(cell) for cell in plan.cells}
        outcome = self._computed(replace(plan, cells=tuple(logged.values())))
        return {digest: outcome.cells[cell.digest]["summary"] for digest, cell in logged.items()}


def check_persons(
    persons: Sequence[str],
    are_recorded: bool,
    others: Sequence[str] = (),
    option: str = "--people",
    instead: str = "",
) -> None:
    """Raise `InputError` unless there are at least two persons.

    ``others`` are trials of other people, ``option`` is what chose the persons, ``instead`` a command
    for a single one.
    """
    if len(persons) >= MIN_PERSONS:
        return
    rule = "must be of at least two people, as confidence is over people"
    if are_recorded:
        rule += ": seeds of one person's trials tell of no other; "
        rule += f"--trials takes those of others, too: {in_few(others)}" if others else "the folder has no others"
        rule += f"; the errors of {persons[0]} alone, network by network: {instead}" if instead else ""
    else:
        rule += ", and each seed is one"
    if instead:  # which ends the line, to be copied
        raise InputError(Fault(COMMAND, option, rule))
    raise InputError(Fault(COMMAND, option if are_recorded else "--seeds", rule, ", ".join(persons)))


def fault_of(request: Request, network: Network) -> Fault | None:
    """Return why the scenario refuses a network; None if it is valid. The fault names the option ``--over``."""
    settings = [f"{path}={value}" for path, value in network.items()]
    try:
        resolve(request.scenario, request.settings, request.seed, request.duration_s, swept=settings)
    except InputError as error:
        # A fault of the scenario itself comes before one of the network.
        fault = next((one for one in error.faults if "--sweep" not in one.where), error.faults[0])
        return replace(fault, where=fault.where.replace("--sweep", "--over"))
    return None


def _with_networks(request: Request, networks: Sequence[Network]) -> Request:
    """Return the request for these networks, side by side; all have the same paths."""
    paths = list(networks[0])
    return replace(
        request,
        sweeps=tuple(Sweep(path, tuple(network[path] for network in networks)) for path in paths),
        zipped=bool(paths),
    )


def _figure(
    limit: Limit, cells: Sequence[Cell], results: Mapping[str, Any], logged: Mapping[str, Flat], estimator: str
) -> float:
    if limit.name in OF_CELLS:
        return of_cells(limit.name, [results[cell.digest] for cell in cells], estimator)
    return of_summaries(limit, [logged[cell.digest] for cell in cells], estimator)
