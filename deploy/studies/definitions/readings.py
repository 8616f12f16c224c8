"""Readings of "the error of a forecast": four errors, at the horizon or over all steps up to it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import sqrt
from typing import Final, Literal, get_args

import numpy as np

from tis.common.errors import DataError, Fault
from tis.common.sources.jigsaws import RATE_HZ
from tis.deploy.compare.cells.cell import Cell, Training
from tis.deploy.compare.cells.forecasts import ErrorSums
from tis.deploy.compare.cells.identity import cell_of, training_on, value_digest
from tis.deploy.compare.grid import Point
from tis.deploy.compare.plan import Plan, Request, make_plan

# Splits of the trials into training and scored ones, planned as cells of a comparison: three for the same trials.

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


Error = Literal["rmse_3d", "mean_distance", "rmse_axis", "mae_axis"]
Span = Literal["at", "up_to_30_hz", "up_to_10_hz"]

ERRORS: Final[tuple[Error, ...]] = get_args(Error)
SPANS: Final[tuple[Span, ...]] = get_args(Span)
HORIZONS_S: Final = (0.1, 0.5, 1.0, 2.0)
N_AHEAD: Final = round(HORIZONS_S[-1] * RATE_HZ)
ERROR_WORDS: Final[dict[Error, str]] = {
    "rmse_3d": "3D RMSE",
    "mean_distance": "3D mean distance",
    "rmse_axis": "RMSE of an axis",
    "mae_axis": "MAE of an axis",
}
SPAN_WORDS: Final[dict[Span, str]] = {
    "at": "at the horizon",
    "up_to_30_hz": "up to it, 30 Hz",
    "up_to_10_hz": "up to it, 10 Hz",
}
_EVERY: Final = RATE_HZ // 10


@dataclass(frozen=True)
class Reading:
    """One error over one span of steps."""

    error: Error
    span: Span


READINGS: Final = tuple(Reading(error, span) for span, error in product(SPANS, ERRORS))


def steps_of(span: Span, horizon_s: float) -> list[int]:
    """Return the numbers of samples ahead that a span covers, the horizon last."""
    last = round(horizon_s * RATE_HZ)
    if span == "at":
        return [last]
    every = _EVERY if span == "up_to_10_hz" else 1
    return list(range(every, last + 1, every))


def value_mm(sums: ErrorSums, reading: Reading, horizon_s: float) -> float:
    """Return the error in mm, pooled over all forecasts and steps.

    Parameters
    ----------
    sums : ErrorSums
        Sums over at least one forecast, of at least `horizon_s`.
    reading : Reading
        ``rmse_3d``: root of the mean squared distance. ``mean_distance``: mean of the distance. ``rmse_axis`` and
        ``mae_axis``: root of the mean square, and mean of the size, of x, y and z each, then the mean of the three.
    horizon_s : float
        One of `HORIZONS_S`.

    Returns
    -------
    float
        ``mae_axis <= rmse_axis <= rmse_3d`` and ``mean_distance <= rmse_3d``. Oracle: values by hand in the tests.
    """
    rows = np.array(steps_of(reading.span, horizon_s)) - 1
    count = sums.n * len(rows)
    squares_m2 = sums.squares_m2[rows].sum(axis=0) / count
    if reading.error == "rmse_3d":
        return 1000 * sqrt(squares_m2.sum())
    if reading.error == "rmse_axis":
        return 1000 * float(np.sqrt(squares_m2).mean())
    if reading.error == "mean_distance":
        return 1000 * float(sums.distance_m[rows].sum()) / count
    return 1000 * float(sums.absolute_m[rows].sum(axis=0).mean()) / count
