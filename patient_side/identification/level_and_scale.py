"""Level drift and covariance scale of an innovations model, fitted by running its filter over rows.

Forecast errors of an innovations model on positions that it was not fitted to, some samples ahead.

The filter runs over each trial from its first row, as in a run, and its forecasts are compared with the rows
held back. All trials run side by side: they share their gains, which do not depend on data.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import exp, inf, isfinite, log, sqrt
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tis.patient_side.filters.activity import ActivityMean
from tis.patient_side.filters.heads import Surroundings
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter, build_innovations_filter, correct
from tis.patient_side.filters.recent_past import RecentPast
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.horizon import horizon_samples
from tis.patient_side.identification.correction_rows import CorrectionRows, correction_span
from tis.patient_side.identification.coverage import coverage_factor, independent_windows, prediction_factor
from tis.patient_side.identification.fit_correction import FittedCorrection, fit_correction
from tis.patient_side.identification.fit_heads import with_heads
from tis.patient_side.identification.trials import held_out_groups
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel

T = TypeVar("T")

_MIN_SHARE = 1e-12


@dataclass(frozen=True)
class HeldBack:
    """Positions (N_i, 3) of trials in m; the rows of each from ``first_rows`` on are held back.

    ``commands`` (N_i, 3) are those of what the arms follow, in units of the arm, where the model has a response.

    ``grippers_rad`` (N_i,) are the grippers' angles at these rows, ``orientations`` (N_i, 4) the arms',
    ``others`` (N_i, 4) the ways to the other arms and their grippers, NaN without one, and ``people`` who
    moves in each trial, where they are known.
    """

    outputs: tuple[Array, ...]
    first_rows: tuple[int, ...]
    grippers_rad: tuple[Array, ...] = ()
    people: tuple[str, ...] = ()
    commands: tuple[Array, ...] = ()
    orientations: tuple[Array, ...] = ()
    others: tuple[Array, ...] = ()

    def of_trials(self, chosen: NDArray[np.intp]) -> "HeldBack":
        """Return some of the trials."""

        def some(each: tuple[T, ...]) -> tuple[T, ...]:
            return tuple(each[i] for i in chosen) if each else ()

        return HeldBack(
            some(self.outputs),
            some(self.first_rows),
            some(self.grippers_rad),
            some(self.people),
            some(self.commands),
            some(self.orientations),
            some(self.others),
        )

    @property
    def n_rows(self) -> int:
        """Return the largest number of rows held back of a trial."""
        return max(len(y) - first for y, first in zip(self.outputs, self.first_rows, strict=True))

    def moves(self, steps: int) -> list[Array]:
        """Return the moves (M_i, 3) of positions over ``steps`` samples: the errors of hold."""
        both = zip(self.outputs, self.first_rows, strict=True)
        return [y[first:][steps:] - y[first:][:-steps] for y, first in both]

    def forecast_errors(self, filter_: InnovationsFilter, means: Sequence[Array], steps: int) -> list[Array]:
        """Return the errors (M_i, 3) of forecasts over ``steps`` samples from `filtered`'s means, like `moves`."""
        each = zip(self.outputs, self.first_rows, means, strict=True)
        return [y[first:][steps:] - filter_.forecasts(state[:-steps], steps) for y, first, state in each]

    def filtered(self, filter_: InnovationsFilter, unbroken: Unbroken) -> list[Array]:
        """Return the filter's means (N_i - first_i, N) after each of the rows held back. Oracle: the estimator."""
        means, _ = self.run(filter_, unbroken, None)
        return means

    def run(
        self, filter_: InnovationsFilter, unbroken: Unbroken, activity: ActivityMean | None
    ) -> tuple[list[Array], list[Array]]:
        """Return the means, and the ``activity``'s factors on covariances (N_i - first_i,), 1 without one."""
        # Trials side by side, as columns; shorter ones are padded with zeros.
        n_trials, length, earliest = len(self.outputs), max(map(len, self.outputs)), min(self.first_rows)
        shown = filter_.shown(filter_.usual)
        samples = [np.hstack(each) for each in zip(*filter(None, (self.commands, self.outputs)), strict=True)]
        rows = np.zeros((length, samples[0].shape[1], n_trials))
        for i, each in enumerate(samples):
            rows[: len(each), :, i] = each
        # The filter in an unbroken row; the means from the first row held back on are kept.
        step = filter_.onward[1]
        means = np.stack([filter_.start(each[0])[0] for each in samples], axis=2).reshape(filter_.n_states, -1)
        kept, factors = np.empty((length - earliest, *means.shape)), np.ones((length, n_trials))
        surprises = np.ones((length, n_trials))
        for k in range(length):
            if k:
                stage = unbroken.stage(k + 1)
                means = step.dot(means)
                innovation = correct(means, unbroken.gains[stage], rows[k], shown)[: filter_.n_axes]
                if activity is not None:
                    surprises[k] = np.square(innovation).reshape(AXES, -1).sum(axis=0) / unbroken.variances[stage]
            if k >= earliest:
                kept[k - earliest] = means
        if activity is not None:
            for i in range(n_trials):
                factors[:, i] = _factors(activity, surprises[:, i])
        # Each trial's own rows.
        kept = kept.reshape(len(kept), -1, n_trials)
        both = list(zip(self.outputs, self.first_rows, strict=True))
        return (
            [kept[first - earliest : len(y) - earliest, :, i] for i, (y, first) in enumerate(both)],
            [factors[first : len(y), i] for i, (y, first) in enumerate(both)],
        )


def _factors(activity: ActivityMean, surprises: Array) -> Array:
    """Return the factor after each surprise; the first row has no forecast and keeps the initial factor."""
    now = activity.initial()
    factors = [now[0]]
    for surprise in surprises[1:].tolist():
        now = activity.after(now, surprise)
        factors.append(now[0])
    return np.array(factors)


def error_over_hold(
    held_back: HeldBack, filter_: InnovationsFilter, unbroken: Unbroken, horizons: Sequence[int]
) -> float:
    """Return the geometric mean, over trials and ``horizons``, of the rms error of forecasts over that of hold.

    A relative improvement then counts equally at 33 ms, where errors are small, and at a second, and equally in a
    quiet trial and in one with large movements, whose squares would outweigh all others.
    """
    means, shares = held_back.filtered(filter_, unbroken), []
    for steps in horizons:
        errors = held_back.forecast_errors(filter_, means, steps)
        for missed, moved in zip(errors, held_back.moves(steps), strict=True):
            total = float(np.sum(np.square(moved)))
            if total > 0:
                shares.append(max(float(np.sum(np.square(missed))) / total, _MIN_SHARE))
    return float(np.exp(np.mean(np.log(shares)) / 2)) if shares else 0.0


LEVEL_STEPS = (0.05, 0.1, 0.2, 0.4)
"""Standard deviations of the level's step, in units of the innovations'."""

_VALIDATED_S = (1 / 30, 0.1, 0.2, 0.5, 1.0)
_STRETCH_S = 4
_SIGNIFICANCE = 1e-3
_SETTLED_S = 2
_N_SCALES = 14
_FEWEST_PEOPLE = 3
_EVERY_STEP = 10
"""Horizons up to which a correction is fitted to each number of samples, as the phase of a clock requires."""


@dataclass(frozen=True)
class Tried:
    """A model's filter, and the error of its forecasts of the held-back rows over that of hold."""

    filter: InnovationsFilter
    unbroken: Unbroken
    error: float


def try_model(model: InnovationsModel, held_back: HeldBack, rate_hz: int) -> Tried:
    """Return a model's `error_over_hold` at 33 .. 1000 ms on the rows held back; inf if it diverges."""
    horizon = _horizon(held_back, rate_hz)
    # A movement without noise leaves innovations close to zero, on which the filter can overflow.
    with np.errstate(over="ignore", invalid="ignore"):
        filter_ = build_innovations_filter(model, horizon)
        unbroken = Unbroken.of(filter_, max(map(len, held_back.outputs)))
        error = error_over_hold(held_back, filter_, unbroken, _horizons(horizon, rate_hz))
    return Tried(filter_, unbroken, error if isfinite(error) else inf)


def clearly_better(one: Tried, other: Tried, held_back: HeldBack, rate_hz: int) -> bool:
    """Return whether ``one`` forecasts the rows held back significantly better than ``other``.

    The difference of squared errors, relative to the other's in the trial and over the horizon, is summed by
    stretches of 4 s, which a one-sided Student's test compares at a level of 0.1 %: strict, as neighbouring stretches
    are not quite independent and the tails are heavy.
    """
    length = _STRETCH_S * rate_hz
    means = [held_back.filtered(each.filter, each.unbroken) for each in (one, other)]
    stretches = [np.zeros(1 + (len(state) - 1) // length) for state in means[0]]
    for h in _horizons(min(one.filter.horizon, other.filter.horizon), rate_hz):
        mine, others = (
            held_back.forecast_errors(each.filter, mean, h) for each, mean in zip((one, other), means, strict=True)
        )
        for stretch, error, reference in zip(stretches, mine, others, strict=True):
            total = float(np.sum(np.square(reference)))
            if total > 0:
                worse = np.sum(error**2 - reference**2, axis=1) / total
                np.add.at(stretch, np.arange(len(worse)) // length, worse)
    worse = np.concatenate(stretches)
    n = len(worse)
    if n < 2:
        return False
    quantile = float(stdtrit(n - 1, 1.0 - _SIGNIFICANCE))
    return float(np.sum(worse)) < -quantile * sqrt(n) * float(np.std(worse, ddof=1))


def settled_rows(held_back: HeldBack, rate_hz: int) -> HeldBack:
    """Return all rows but the first 2 s of each trial."""
    return replace(held_back, first_rows=tuple(min(_SETTLED_S * rate_hz, len(y) - 1) for y in held_back.outputs))


def _horizon(held_back: HeldBack, rate_hz: int) -> int:
    return min(horizon_samples(rate_hz), max(1, held_back.n_rows - 1))


def _horizons(longest: int, rate_hz: int) -> list[int]:
    wanted = sorted({max(1, round(s * rate_hz)) for s in _VALIDATED_S})
    return [h for h in wanted if h <= longest] or [1]


def with_level(
    model: InnovationsModel,
    of_first: InnovationsModel,
    held_back: HeldBack,
    rate_hz: int,
    first_tried: Tried | None = None,
) -> InnovationsModel:
    """Return ``model`` with the level step that validates best for ``of_first``, the model of the rows not held back.

    ``first_tried`` is the result of `try_model` for ``of_first``, if it exists.
    """
    errors = {}
    for step in (of_first.level_step,) if of_first.integrated else LEVEL_STEPS:
        tried = first_tried if step == of_first.level_step else None
        tried = tried or try_model(replace(of_first, level_step=step), held_back, rate_hz)
        errors[step] = tried.error
    return replace(model, level_step=min(errors, key=errors.__getitem__))


class Calibrated(NamedTuple):
    """A model with the scale of its covariances, and its correction's ``gain`` over ``steps`` samples (H,).

    The gain is the error of forecasts, on rows that the correction was not fitted to, over that without correction;
    ``over_hold`` is that error over hold's.
    """

    model: InnovationsModel
    steps: NDArray[np.int64]
    gain: Array
    over_hold: Array


def with_scale(model: InnovationsModel, held_back: HeldBack, rate_hz: int, *, corrected: bool = False) -> Calibrated:
    """Return ``model`` with the scale of the covariances of its forecasts, and with a correction where ``corrected``.

    Both are fitted to all rows but the first 2 s of each trial. The scale is `coverage_factor` on errors in units of
    the activity at the time, those of a correction on rows held out, times `prediction_factor`, as the model was
    fitted to the same rows: each state contributes one coefficient per axis to a forecast.
    """
    # The filter over all rows, and the horizons to calibrate.
    rows, horizon = settled_rows(held_back, rate_hz), _horizon(held_back, rate_hz)
    corrected = corrected and horizon >= 2 * correction_span(rate_hz)
    with_past = corrected or model.response is not None
    filter_ = build_innovations_filter(model, horizon, past=RecentPast.at_rate(rate_hz) if with_past else None)
    longest = max(map(len, held_back.outputs))
    unbroken = Unbroken.of(filter_, longest)
    means, activities = rows.run(filter_, unbroken, ActivityMean.at_rate(rate_hz))
    # Forecast errors, with the correction where the horizon is long enough for the hand's acceleration.
    fitted: FittedCorrection | None = None
    if corrected:
        steps = forecast_steps(held_back, rate_hz)
        found = _correction_rows(rows, means, activities, rate_hz, with_heads=model.response is None)
        fitted = with_heads(fit_correction(found, filter_, steps, rate_hz), steps, rate_hz)
        errors = fitted.errors
        left = over_hold(rows, steps, errors)
        gain = left / over_hold(rows, steps, fitted.linear_errors)
    else:
        steps = np.unique(_spread(horizon))
        errors, gain = [rows.forecast_errors(filter_, means, h) for h in steps.tolist()], np.ones(len(steps))
        left = over_hold(rows, steps, errors)
    # The factor for each horizon.
    covariance = unbroken.covariances[unbroken.stage(longest // 2)]

    def scale_of(errors: Sequence[Sequence[Array]]) -> Array:
        scale = []
        for h, each in zip(steps.tolist(), errors, strict=True):
            even = np.concatenate(each) / np.sqrt(np.concatenate([activity[:-h] for activity in activities]))[:, None]
            by_chance = prediction_factor(independent_windows(len(even), h), model.order / AXES)
            spread = filter_.spread(covariance, h, 0.0)
            if filter_.arm_error is not None:  # the rows have errors of the sensor, which forecasts are not of
                spread = spread + filter_.arm_error * filter_.unit
            scale.append(by_chance * coverage_factor(even, spread, h))
        return np.array(scale)

    correction = None
    if fitted is not None:
        correction = replace(fitted.correction, linear_scale=scale_of(fitted.linear_errors))
    scaled = replace(
        model, scale_horizons=steps.astype(float), covariance_scale=scale_of(errors), correction=correction
    )
    return Calibrated(scaled, steps, gain, left)


def errors_on(model: InnovationsModel, rows: HeldBack, steps: NDArray[np.int64]) -> list[list[Array]]:
    """Return the errors (M_i, 3) of a model's forecasts on rows that it was not fitted to, by horizon and trial."""
    filter_ = build_innovations_filter(model, int(steps[-1]))
    means = rows.filtered(filter_, Unbroken.of(filter_, max(map(len, rows.outputs))))
    return [rows.forecast_errors(filter_, means, h) for h in steps.tolist()]


def over_hold(rows: HeldBack, steps: NDArray[np.int64], errors: Sequence[Sequence[Array]]) -> Array:
    """Return the geometric mean (H,) over trials of the rms errors over those of hold."""
    ratios = []
    for h, of_trials in zip(steps.tolist(), errors, strict=True):
        logs = [
            log(max(float(np.sum(error**2)) / float(np.sum(moved**2)), _MIN_SHARE)) / 2
            for error, moved in zip(of_trials, rows.moves(h), strict=True)
            if np.any(moved)
        ]
        ratios.append(exp(sum(logs) / len(logs)) if logs else 1.0)
    return np.array(ratios)


def forecast_steps(held_back: HeldBack, rate_hz: int) -> NDArray[np.int64]:
    """Return the horizons (H,) of corrections in samples: every one up to 10, and ever fewer beyond."""
    horizon = _horizon(held_back, rate_hz)
    return np.unique(np.concatenate([np.arange(1, min(_EVERY_STEP, horizon) + 1), _spread(horizon)]))


def _spread(horizon: int) -> NDArray[np.int64]:
    return np.round(np.geomspace(1, horizon, _N_SCALES)).astype(int)


def _correction_rows(
    rows: HeldBack, means: Sequence[Array], activities: Sequence[Array], rate_hz: int, *, with_heads: bool
) -> list[CorrectionRows]:
    """Return the settled rows of each trial; unknown grippers are at 0.

    Heads need several people: what they learn of one place and task is worth nothing elsewhere.
    """
    groups = held_out_groups([len(each) for each in activities], rows.people)
    grippers = rows.grippers_rad or tuple(np.zeros(len(y)) for y in rows.outputs)
    around: list[Surroundings | None] = [None] * len(groups)
    if with_heads and rows.orientations and len(set(rows.people)) >= _FEWEST_PEOPLE:
        others = rows.others or tuple(np.full((len(y), 4), np.nan) for y in rows.outputs)
        both = zip(rows.orientations, grippers, others, rows.first_rows, strict=True)
        around = [Surroundings.of_rows(np.column_stack([q, g]), o, first, rate_hz) for q, g, o, first in both]
    each = zip(rows.outputs, rows.first_rows, means, activities, grippers, groups, around, strict=True)
    return [CorrectionRows(y[i:], s, a, g[i:], group, w) for y, i, s, a, g, group, w in each]
