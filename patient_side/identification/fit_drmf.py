"""The model of `drmf`: size and numbers of its factorisation, selected on rows and people held out.

What is judged is the forecast at drawn ticks, of which positions were lost or late: see `arrival_draws`. The numbers
are selected one after another; of those whose errors differ too little to tell, the one that costs least.

Drawn ticks of training rows: for each, which positions have arrived, under drawn loss and delay.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.common.streams import Stream
from tis.patient_side.filters.hankel_completion import column_moments, complete_all
from tis.patient_side.identification.coverage import coverage_factor, prediction_factor
from tis.patient_side.identification.noise import SENSOR_RESOLUTION_M
from tis.patient_side.identification.trials import held_out_groups
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import CompletionModel, Factorisation

MAX_P_LOSS = 0.3
MAX_JITTER_STEPS = 15.0
_MIN_PAST = 8


@dataclass(frozen=True)
class ArrivalDraw:
    """A tick at ``row`` of a trial, ``ahead`` steps after the newest position that has arrived.

    ``arrived`` (A,) tells of the positions 0 .. A - 1 steps before the tick whether they have.
    """

    trial: int
    row: int
    ahead: int
    arrived: NDArray[np.bool_]

    def window(self, y: Array, n_steps: int, end: int) -> tuple[Array, NDArray[np.bool_]]:
        """Return ``n_steps`` positions (n_steps, 3) of a trial (N, 3) up to row ``end``, and which have arrived.

        They are relative to the newest that has; rows before the trial's first have not.
        """
        rows = np.arange(end - n_steps + 1, end + 1)
        ages = self.row - rows
        known = (rows >= 0) & (ages >= 0) & (ages < len(self.arrived))
        known[known] = self.arrived[ages[known]]
        inside = np.clip(rows, 0, len(y) - 1)
        return np.where(known[:, None], y[inside] - y[self.row - self.ahead], 0.0), known


def arrival_draws(
    lengths: Sequence[int], horizons: Sequence[int], n_each: int, n_steps: int, label: str
) -> list[ArrivalDraw]:
    """Return ``n_each`` draws at each of ``horizons``, all below ``n_steps``, from trials of ``lengths`` rows.

    There are none at a horizon that no trial is long enough for.

    The row is drawn from all rows with some past. Each position is lost with a probability that is drawn for the
    tick, up to 30 %; in every second draw positions are also late by up to 15 steps more than the newest. The random
    numbers are those of the stream ``label``, the same in every call.
    """
    stream, draws = Stream.named(0, label), []
    for i, ahead in enumerate(horizons):
        first = ahead + _MIN_PAST
        eligible = np.cumsum([0] + [max(0, n - first) for n in lengths])
        if eligible[-1] == 0:
            continue
        for j in range(n_each):
            u = stream.uniforms((i * n_each + j) * (2 * n_steps + 3), 2 * n_steps + 3)
            place = int(u[0] * eligible[-1])
            trial = int(np.searchsorted(eligible, place, side="right")) - 1
            jitter = MAX_JITTER_STEPS * u[2] * (j % 2)
            ages = np.arange(n_steps)
            arrived = (u[3 : n_steps + 3] >= MAX_P_LOSS * u[1]) & (ages >= ahead + jitter * u[n_steps + 3 :])
            arrived[ahead] = True
            draws.append(ArrivalDraw(trial, first + place - int(eligible[trial]), ahead, arrived))
    return draws


_STEP_HZ: Final = 30
_HORIZONS: Final = (1, 2, 3, 4, 6, 8, 11, 15, 20, 30, 60, 150)
_JUDGED: Final = (1, 3, 6, 15, 30)
_MAX_ROWS: Final = 45
_MIN_STEPS: Final = 32
_MAX_TURNS: Final = 3
_TOLERANCE_M: Final = 1e-5
_N_JUDGED: Final = 40
_N_CALIBRATED: Final = 240
_AT_ONCE: Final = 16
"""Draws completed together: more would leave the processor's cache."""
_SHARES: Final = (0.1, 0.03)
_AS_GOOD: Final = 0.004
"""Difference of scores that does not count: 0.4 % of the error."""
_MOST_STEPS: Final = 240
"""More than the longest horizon and any candidate's matrix together."""


@dataclass(frozen=True)
class Choice:
    """A candidate: rows R and columns C of the matrix, weight of the training rows, and numbers of the factorisation.

    ``share`` of the positions may be outliers, none smaller than ``least_outlier_m``.
    """

    n_rows: int = 30
    n_columns: int = 60
    prior_columns: float = 3000.0
    rank: int = 16
    ridge: float = 1.0
    share: float = 0.0
    least_outlier_m: float = 0.0

    @property
    def n_steps(self) -> int:
        """Number of steps in the matrix."""
        return self.n_rows + self.n_columns - 1

    @property
    def longest(self) -> int:
        """The longest forecast: two thirds of a column, so that the last one knows a third of its entries."""
        return 2 * self.n_rows // 3

    @property
    def factorisation(self) -> Factorisation:
        """The numbers of the factorisation."""
        return Factorisation(
            rank=min(self.rank, self.n_rows - 2),
            ridge=self.ridge,
            n_outliers=round(self.share * self.n_steps),
            least_outlier_m=self.least_outlier_m,
            least_noise_m2=SENSOR_RESOLUTION_M**2,
            tolerance_m=_TOLERANCE_M,
            max_turns=_MAX_TURNS,
        )


def _variants(choice: Choice, most_rows: int) -> list[list[Choice]]:
    """Return the candidates of each number in turn, the one with the least cost first."""
    rows = [replace(choice, n_rows=n) for n in (20, 30, 45) if n <= most_rows]
    weights = [replace(choice, prior_columns=n) for n in (0.0, 300.0, 3000.0, 30_000.0)]
    ranks = [replace(choice, rank=n) for n in (4, 8, 12, 16, 24)]
    ridges = [replace(choice, ridge=x) for x in (0.3, 1.0, 3.0)]
    columns = [replace(choice, n_columns=n) for n in (20, 60)]
    return [rows, weights, ranks, ridges, columns]


def fit_drmf(outputs: Sequence[Array], rate_hz: int, people: Sequence[str] = ()) -> CompletionModel:
    """Return the model of one arm's or several arms' positions (N, 3) in m; raises `DataError` for too few rows.

    Parameters
    ----------
    outputs : Sequence[Array]
        Positions by trial, in m.
    rate_hz : int
        Rate of the rows; a step is a 30th of a second, or a sample where that is longer.
    people : Sequence[str]
        Who moves in each trial; where they are several, the numbers must serve people held out.

    Returns
    -------
    CompletionModel
        Its forecasts end at two thirds of a column, and no column is longer than a quarter of the longest trial.

    Notes
    -----
    Oracles in test_fit_drmf: a movement of known rank, a random walk, moves computed one by one.
    """
    stride = max(1, round(rate_hz / _STEP_HZ))
    steps = [y[::stride] for y in outputs]
    longest = max(map(len, steps), default=0)
    if longest < _MIN_STEPS:
        rule = f"drmf needs {_MIN_STEPS * stride} rows in one trial"
        raise DataError(Fault("identification", "training rows", rule, longest * stride))
    held_out = _HeldOut.of(steps, people, min(_MAX_ROWS, longest // 4))
    draws = held_out.draws(_JUDGED, _N_JUDGED, "drmf/select")
    choice = _chosen(held_out, draws)
    horizons, covariances, most_left_m = _errors_by_horizon(held_out, choice)
    choice = _made_robust(held_out, draws, choice, most_left_m)
    return CompletionModel(
        stride=stride,
        n_columns=choice.n_columns,
        moves_m2=held_out.moves_m2(None, choice.n_rows),
        prior_columns=choice.prior_columns,
        factorisation=choice.factorisation,
        longest=choice.longest,
        horizons=horizons,
        covariance_m2=covariances,
    )


@dataclass(frozen=True, eq=False)
class _HeldOut:
    """Trials, the group of each row, and sums of square moves (G, R) over 0 .. R - 1 steps, with their counts."""

    trials: Sequence[Array]
    groups: Sequence[NDArray[np.intp]]
    squares_m2: Array
    counts: Array

    @classmethod
    def of(cls, trials: Sequence[Array], people: Sequence[str], n_rows: int) -> "_HeldOut":
        groups = held_out_groups([len(y) for y in trials], people)
        n_groups = 1 + max(int(each.max(initial=0)) for each in groups)
        squares, counts = np.zeros((n_groups, n_rows)), np.zeros((n_groups, n_rows))
        for y, group in zip(trials, groups, strict=True):
            for steps in range(min(n_rows, len(y))):
                moves = y[steps:] - y[: len(y) - steps]
                first = group[: len(moves)]
                squares[:, steps] += np.bincount(first, np.sum(moves**2, axis=1), n_groups)
                counts[:, steps] += np.bincount(first, minlength=n_groups) * y.shape[1]
        return cls(trials, groups, squares, counts)

    def moves_m2(self, without: int | None, n_rows: int) -> Array:
        """Return the mean square moves (n_rows,) of all groups, or of all but one where others have any."""
        kept = np.ones(len(self.counts), dtype=bool)
        if without is not None and np.all(np.delete(self.counts, without, axis=0).sum(axis=0) > 0):
            kept[without] = False
        sums, counts = self.squares_m2[kept, :n_rows].sum(axis=0), self.counts[kept, :n_rows].sum(axis=0)
        return np.asarray(sums / counts)

    def draws(self, horizons: Sequence[int], n_each: int, label: str) -> list[ArrivalDraw]:
        """Return drawn ticks at the horizons up to a quarter of the longest trial."""
        lengths = [len(y) for y in self.trials]
        known = [horizon for horizon in horizons if horizon <= max(lengths) // 4]
        return arrival_draws(lengths, known, n_each, _MOST_STEPS, label)

    def forecasts(self, choice: Choice, draws: Sequence[ArrivalDraw]) -> tuple[Array, Array, float]:
        """Return errors (D, 3) and moves (D, 3) of the draws, and the most that L leaves of a position, in m.

        The factors of a draw are those of the other groups' rows.
        """
        moments = [column_moments(self.moves_m2(group, choice.n_rows)) for group in range(len(self.counts))]
        windows = [
            draw.window(self.trials[draw.trial], choice.n_steps, draw.row - max(0, draw.ahead - choice.longest))
            for draw in draws
        ]
        priors = [moments[int(self.groups[draw.trial][draw.row])] for draw in draws]
        moved = np.array([self.trials[draw.trial][draw.row] for draw in draws])
        moved -= [self.trials[draw.trial][draw.row - draw.ahead] for draw in draws]
        newest, most_left_m = [], 0.0
        for first in range(0, len(draws), _AT_ONCE):
            part = slice(first, first + _AT_ONCE)
            paths, known = (np.array(each) for each in zip(*windows[part], strict=True))
            done = complete_all(paths, known, np.array(priors[part]), choice.prior_columns, choice.factorisation)
            newest.append(done.newest[:, -1])
            most_left_m = max(most_left_m, float(done.left_m.max()))
        return np.concatenate(newest) - moved, moved, most_left_m

    def score(self, choice: Choice, draws: Sequence[ArrivalDraw]) -> float:
        """Return the mean over horizons of the logarithm of the mean error, in units of that of hold.

        Distances are judged and not their squares, of which a few draws would be nearly all.
        """
        missed, moves, _ = self.forecasts(choice, draws)
        ahead = np.array([draw.ahead for draw in draws])
        errors, moved = (np.linalg.norm(each, axis=1) + SENSOR_RESOLUTION_M for each in (missed, moves))
        return float(np.mean([np.log(errors[ahead == h].sum() / moved[ahead == h].sum()) for h in np.unique(ahead)]))


def _chosen(held_out: _HeldOut, draws: Sequence[ArrivalDraw]) -> Choice:
    """Return the selected numbers, without outliers."""
    most = held_out.counts.shape[1]
    scores: dict[Choice, float] = {}

    def first_of_the_best(candidates: Sequence[Choice]) -> Choice:
        for each in candidates:
            if each not in scores:
                scores[each] = held_out.score(each, draws)
        best = min(scores[each] for each in candidates)
        return next(each for each in candidates if scores[each] <= best + _AS_GOOD)

    chosen = Choice(n_rows=min(30, most))
    for i in range(len(_variants(chosen, most))):
        chosen = first_of_the_best([*_variants(chosen, most)[i], chosen])
    return chosen


def _made_robust(held_out: _HeldOut, draws: Sequence[ArrivalDraw], choice: Choice, least_outlier_m: float) -> Choice:
    """Return the numbers with the largest share of outliers that costs nothing, since robustness is then free."""
    score = held_out.score(choice, draws)
    robust = [replace(choice, share=share, least_outlier_m=least_outlier_m) for share in _SHARES]
    return next((each for each in robust if held_out.score(each, draws) <= score + _AS_GOOD), choice)


def _errors_by_horizon(held_out: _HeldOut, choice: Choice) -> tuple[NDArray[np.int64], Array, float]:
    """Return horizons (H,), covariances (H, 3, 3) of the errors over them, and the most that L leaves of a position.

    The covariances are such that 95 % ellipsoids hold 95 %.
    """
    draws = held_out.draws(_HORIZONS, _N_CALIBRATED, "drmf/calibrate")
    missed, _, most_left_m = held_out.forecasts(choice, draws)
    ahead = np.array([draw.ahead for draw in draws])
    horizons = np.unique(ahead)
    n_rows = sum(map(len, held_out.trials))
    covariances: list[Array] = []
    for horizon in horizons:
        errors = missed[ahead == horizon]
        covariance = errors.T @ errors / len(errors) + SENSOR_RESOLUTION_M**2 * np.eye(3)
        # Draws from few rows share their movements.
        shared = max(1, round(len(errors) * horizon / n_rows))
        factor = coverage_factor(errors, covariance, shared) * prediction_factor(len(errors) / shared, 0.0)
        # What is known shrinks with the horizon, so an error that seems to shrink does so by chance.
        grown = max(1.0, np.trace(covariances[-1]) / np.trace(factor * covariance)) if covariances else 1.0
        covariances.append(grown * factor * covariance)
    return horizons, np.array(covariances), most_left_m
