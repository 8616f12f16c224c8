"""Splits of the trials into training and scored ones, planned as cells of a comparison: three for the same trials."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, Literal, get_args

from tis.common.errors import DataError, Fault
from tis.deploy.compare.cells.cell import Cell, Training
from tis.deploy.compare.cells.digests import value_digest
from tis.deploy.compare.cells.identity import cell_of, training_on
from tis.deploy.compare.definitions.readings import N_AHEAD
from tis.deploy.compare.grid import Point
from tis.deploy.compare.plan import Plan, Request, make_plan

Split = Literal["user", "supertrial", "own"]

SPLITS: Final[tuple[Split, ...]] = get_args(Split)
SPLIT_WORDS: Final[dict[Split, str]] = {
    "user": "one user out",
    "supertrial": "one supertrial out",
    "own": "own trial",
}
NAMES: Final = ("hold", "innovations_kf")
_RECORDED: Final = "source={kind: jigsaws, task: Suturing, hands: [left, right]}"
_AT_ONCE: Final = "network={forward: {delay: {kind: constant, delay_ms: 0}}}"


def plan_splits(settings: Sequence[str], duration_s: float | None) -> Plan:
    """Return one plan with the cells of all splits; the setting of a cell is its split.

    ``user``: models of all other people. ``supertrial``: models of all trials with another number, the same person's
    included. ``own``: models of the first rows of the trial, which is scored after them. Raises `InputError`, and
    `DataError` where there are no trials of at least two people.
    """
    has_source = any(setting.partition("=")[0] == "source" for setting in settings)
    common = (*(() if has_source else (_RECORDED,)), _AT_ONCE, *settings)
    user = make_plan(Request("default", common, NAMES, duration_s=duration_s))
    _check_people(user)
    own = make_plan(Request("default", (*common, "identification.train=own_head"), NAMES, duration_s=duration_s))
    trainings = {**user.trainings, **own.trainings}
    cells = [*_forecasting(user.cells, "user"), *_forecasting(own.cells, "own")]
    for number in sorted({trial[1:] for trial in user.trials}):
        tested = [cell for cell in user.cells if cell.trial[1:] == number]
        training = _supertrial_training(user, tested, number)
        if training is not None:
            trainings[training.digest] = training
            retrained = [cell_of(cell.scenario, None, cell.trial, training, {}) for cell in tested]
            cells += _forecasting(retrained, "supertrial")
    return replace(
        user,
        points=tuple(Point(split, {}) for split in SPLITS),
        trainings={digest: replace(training, timed=False) for digest, training in trainings.items()},
        cells=tuple(cells),
        refused=tuple({str(fault): fault for fault in (*user.refused, *own.refused)}.values()),
    )


def _check_people(plan: Plan) -> None:
    people = sorted({trial[0] for trial in plan.trials})
    if len(people) < 2:
        found = ", ".join(plan.trials)
        raise DataError(Fault("tis compare", "--definitions", f"needs trials of at least two people; found: {found}"))


def _forecasting(cells: Sequence[Cell], split: Split) -> list[Cell]:
    """Return the cells with forecasts, each with a digest of its own."""
    return [
        replace(cell, setting=split, n_ahead=N_AHEAD, digest=value_digest([cell.digest, "ahead", N_AHEAD]))
        for cell in cells
    ]


def _supertrial_training(plan: Plan, tested: Sequence[Cell], number: str) -> Training | None:
    """Return the training on all trials with another number, None without any."""
    names = tuple(trial for trial in plan.trials if trial[1:] != number)
    if not names or not tested:
        return None
    own = tested[0].training
    assert own is not None
    base = replace(plan.trainings[own], scenario=tested[0].scenario)
    return training_on(base, names, f"all trials but number {number}")
