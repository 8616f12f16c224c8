"""Level drift and covariance scale of an innovations model, fitted by running its filter over rows."""

from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt

import numpy as np
from scipy.special import stdtrit

from patient_side.filters.activity import ActivityMean
from patient_side.filters.innovations_filter import AXES, InnovationsFilter, build_innovations_filter
from patient_side.filters.unbroken import Unbroken
from patient_side.horizon import horizon_samples
from patient_side.identification.coverage import coverage_factor, independent_windows, prediction_factor
from patient_side.identification.fit_reach import fit_reach, reach_span
from patient_side.identification.forecast_error import HeldBack, error_over_hold
from patient_side.identification.structure import innovation_sizes
from patient_side.statespace import InnovationsModel

LEVEL_STEPS = (0.05, 0.1, 0.2, 0.4)
"""Standard deviations of the level's step, in units of the innovations'."""

_VALIDATED_S = (1 / 30, 0.1, 0.2, 0.5, 1.0)
_STRETCH_S = 4
_SIGNIFICANCE = 1e-3
_SETTLED_S = 2
_N_SCALES = 14


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


def _settled_rows(held_back: HeldBack, rate_hz: int) -> HeldBack:
    """Return all rows but the first 2 s of each trial."""
    return replace(held_back, first_rows=tuple(min(_SETTLED_S * rate_hz, len(y) - 1) for y in held_back.outputs))


def _horizon(held_back: HeldBack, rate_hz: int) -> int:
    return min(horizon_samples(rate_hz), max(1, held_back.n_rows - 1))


def _horizons(longest: int, rate_hz: int) -> list[int]:
    wanted = sorted({max(1, round(s * rate_hz)) for s in _VALIDATED_S})
    return [h for h in wanted if h <= longest] or [1]


def with_level_and_scale(
    model: InnovationsModel,
    of_first: InnovationsModel,
    held_back: HeldBack,
    rate_hz: int,
    first_tried: Tried | None = None,
) -> InnovationsModel:
    """Return ``model`` with level step, reach and scale; ``of_first`` is the model of the rows not held back.

    ``first_tried`` is the result of `try_model` for ``of_first``, if it exists.
    """
    errors = {}
    for step in (of_first.level_step,) if of_first.integrated else LEVEL_STEPS:
        tried = first_tried if step == of_first.level_step else None
        tried = tried or try_model(replace(of_first, level_step=step), held_back, rate_hz)
        errors[step] = tried.error
    level_step = min(errors, key=errors.__getitem__)
    found = replace(model, level_step=level_step)
    return with_reach_and_scale(found, held_back, rate_hz)


def with_reach_and_scale(model: InnovationsModel, held_back: HeldBack, rate_hz: int) -> InnovationsModel:
    """Return ``model`` with the phase of a reach, and with the scale of the covariances of its forecasts.

    Both are fitted to all rows but the first 2 s of each trial. Only isotropic models include reaches; the forecasts
    of others stay linear. The scale is `coverage_factor` on cross-validated errors in units of the activity at the
    time, times `prediction_factor`, as the model was fitted to the same rows: each state contributes one coefficient
    per axis to a forecast.
    """
    # The filter over all rows, and the horizons to calibrate.
    rows, horizon = _settled_rows(held_back, rate_hz), _horizon(held_back, rate_hz)
    filter_ = build_innovations_filter(model, horizon)
    longest = max(map(len, held_back.outputs))
    unbroken = Unbroken.of(filter_, longest)
    means, activities = rows.run(filter_, unbroken, ActivityMean.at_rate(rate_hz))
    steps = np.unique(np.round(np.geomspace(1, horizon, _N_SCALES)).astype(int))
    # Forecast errors, with the phase of the reach where the horizon is long enough for the hand's acceleration.
    if model.isotropic and horizon >= 2 * reach_span(rate_hz):
        settled = [y[first:] for y, first in zip(rows.outputs, rows.first_rows, strict=True)]
        angles = [g[first:] for g, first in zip(rows.grippers_rad, rows.first_rows, strict=False)]
        sizes = innovation_sizes(held_back.outputs)
        fitted = fit_reach(settled, means, activities, sizes, filter_, steps, rate_hz, angles)
        model, errors = replace(model, reach=fitted.reach), fitted.errors
    else:
        errors = [rows.forecast_errors(filter_, means, h) for h in steps.tolist()]
    # The factor for each horizon.
    covariance, scale = unbroken.covariances[unbroken.stage(longest // 2)], []
    for h, each in zip(steps.tolist(), errors, strict=True):
        even = np.concatenate(each) / np.sqrt(np.concatenate([activity[:-h] for activity in activities]))[:, None]
        by_chance = prediction_factor(independent_windows(len(even), h), model.order / AXES)
        scale.append(by_chance * coverage_factor(even, filter_.spread(covariance, h, 0.0), h))
    return replace(model, scale_horizons=steps.astype(float), covariance_scale=np.array(scale))
