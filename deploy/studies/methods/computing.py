"""Computation of all methods' twins at once, and of each method what was found or why it is missing."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from rich.console import Console
from rich.markup import escape

from tis.common.errors import TisError
from tis.common.scenario.estimator_names import is_learned
from tis.deploy.compare.cells.store import Store
from tis.deploy.compare.command import run
from tis.deploy.compare.engine.compute import Outcome
from tis.deploy.compare.engine.workers import Workers
from tis.deploy.compare.plan import Plan
from tis.deploy.compare.results.pooled import person
from tis.deploy.compare.results.report import report
from tis.deploy.studies.methods.plans import HOLD, Measure, Subject, merged, plans_of
from tis.patient_side.learning.train import check_extra

Hands = list[dict[str, Any]]
UNTRAINED: Final[tuple[Measure, ...]] = ("accuracy", "loss", "noise", "reliability", "fast")
"""Measures that a method without training has."""


@dataclass(frozen=True)
class Computed:
    """The plans of one method and the outcome of all; ``gaps`` say what is missing, and why."""

    subject: Subject
    plans: dict[Measure, Plan]
    outcome: Outcome
    gaps: tuple[str, ...]

    def rows(self, measure: Measure) -> list[dict[str, Any]]:
        """Return the pooled scores of the method at each setting of a measure, those that were computed."""
        if measure not in self.plans:
            return []
        found = report(self.plans[measure], self.outcome, "")["rows"]
        return [row for row in found if row["estimator"] == self.subject.estimator]

    def hands(self, measure: Measure, setting: str | None) -> dict[str, Hands]:
        """Return the sums of the hands of each person at one setting; no person without a result."""
        people: dict[str, Hands] = {}
        for cell in self.plans[measure].cells if measure in self.plans else ():
            result = self.outcome.cells.get(cell.digest)
            if cell.setting == setting and result is not None:
                people.setdefault(person(cell), []).extend(result["hands"].values())
        return people

    def trainings(self, measure: Measure, setting: str | None) -> list[dict[str, Any]]:
        """Return the results of the trainings at one setting, each once."""
        cells = self.plans[measure].cells if measure in self.plans else ()
        digests = dict.fromkeys(cell.training for cell in cells if cell.setting == setting)
        found = self.outcome.trainings
        return [found[digest] for digest in digests if digest is not None and digest in found]


def compute_methods(subjects: Sequence[Subject], store: Store, workers: Workers, err: Console) -> list[Computed]:
    """Compute what the store lacks for all methods together, and return what there is of each.

    A method that cannot be planned, trained or run is a gap, not an error, as the others do not need it; only where
    none can be planned its `InputError` or `DataError` is raised. `hold`, which runs beside every method and needs no
    training, is read from the twins of the first one that is complete.
    """
    planned: dict[str, dict[Measure, Plan]] = {}
    faults: dict[str, TisError] = {}
    for subject in subjects:
        try:
            if is_learned(subject.method):
                check_extra([subject.method])  # or its trainings fail one by one, which is told at the end
            planned[subject.method] = {} if subject.method == HOLD else plans_of(subject)
        except TisError as error:
            faults[subject.method] = error
            err.print(escape(f"{subject.method} is left out: {error}"), style="yellow")
    plans = [each for found in planned.values() for each in found.values()]
    if not plans:
        raise next(iter(faults.values()))
    with workers:
        outcome = run(merged(plans), store, workers, err)
    computed = [
        Computed(each, own := planned.get(each.method, {}), outcome, _gaps(each.method, own, outcome, faults))
        for each in subjects
    ]
    return [_of_hold(each, computed) if each.subject.method == HOLD else each for each in computed]


def _of_hold(hold: Computed, computed: Sequence[Computed]) -> Computed:
    """Return what was found of `hold` beside another method."""
    beside = next((each for each in computed if each.plans and not each.gaps), None)
    if beside is None:
        return replace(hold, gaps=("no other method is complete, beside which it runs",))
    return replace(hold, plans={measure: beside.plans[measure] for measure in UNTRAINED})


def _gaps(method: str, plans: dict[Measure, Plan], outcome: Outcome, faults: dict[str, TisError]) -> tuple[str, ...]:
    """Return what is missing of a method, each reason once."""
    if method in faults:
        return tuple(map(str, faults[method].faults))
    reasons = [each.reason for each in outcome.failures if each.label.startswith(f"training on {method}, ")]
    lacking = {
        measure: sum(cell.digest not in outcome.cells for cell in plan.cells) for measure, plan in plans.items()
    }
    missing = ", ".join(f"{measure} {n}" for measure, n in lacking.items() if n)
    if missing and not reasons:
        reasons = [each.reason for each in outcome.failures]
    return (*dict.fromkeys(reasons), *([f"twins missing: {missing}"] if missing else []))
