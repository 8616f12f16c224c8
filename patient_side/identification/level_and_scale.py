"""What is found of an innovations model by running its filter over rows: drift of the level, honest covariances."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import inf, isfinite, sqrt

import numpy as np
from scipy.special import stdtrit

from patient_side.activity import ActivityMean
from patient_side.horizon import horizon_samples
from patient_side.identification.coverage import coverage_factor
from patient_side.identification.forecast_error import HeldBack, error_over_hold
from patient_side.innovations_filter import InnovationsFilter, build_innovations_filter
from patient_side.statespace import Array, InnovationsModel
from patient_side.unbroken import Unbroken

LEVEL_STEPS = (0.05, 0.1, 0.2, 0.4)
"""Deviations of the level's step, in units of the innovations'."""

_VALIDATED_S = (1 / 30, 0.1, 0.2, 0.5, 1.0)
_STRETCH_S = 4
_BY_CHANCE = 1e-3
_SETTLED_S = 2
_N_SCALES = 14


@dataclass(frozen=True)
class Tried:
    """A model's filter, and the error of its forecasts of the held-back rows over that of holding."""

    filter: InnovationsFilter
    unbroken: Unbroken
    error: float


def try_model(model: InnovationsModel, held_back: HeldBack, rate_hz: int) -> Tried:
    """Return how a model forecasts rows held back: `error_over_hold` at 33 .. 1000 ms; inf if it diverges."""
    horizon = min(horizon_samples(rate_hz), max(1, held_back.n_rows - 1))
    with np.errstate(over="ignore", invalid="ignore"):  # of a movement without noise hardly any innovations are left
        filter_ = build_innovations_filter(model, horizon)
        unbroken = Unbroken.of(filter_, max(map(len, held_back.outputs)))
        error = error_over_hold(held_back, filter_, unbroken, _horizons(horizon, rate_hz))
    return Tried(filter_, unbroken, error if isfinite(error) else inf)


def clearly_better(one: Tried, other: Tried, held_back: HeldBack, rate_hz: int) -> bool:
    """Return whether ``one`` forecasts the rows held back better than ``other``, by more than chance does.

    The difference of squared errors, relative to the other's in the trial and over the horizon, is summed by
    stretches of 4 s. Of these Student's test is asked, one-sided, at a level of 0.1 %: neighbours are not quite
    independent, and tails are heavy.
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
    return float(np.sum(worse)) < -float(stdtrit(n - 1, 1.0 - _BY_CHANCE)) * sqrt(n) * float(np.std(worse, ddof=1))


def _settled_rows(outputs: Sequence[Array], rate_hz: int) -> HeldBack:
    """Return all rows but the first 2 s of each trial."""
    return HeldBack(tuple(outputs), tuple(min(_SETTLED_S * rate_hz, len(y) - 1) for y in outputs))


def _horizons(longest: int, rate_hz: int) -> list[int]:
    wanted = sorted({max(1, round(s * rate_hz)) for s in _VALIDATED_S})
    return [h for h in wanted if h <= longest] or [1]


def with_level_and_scale(
    model: InnovationsModel,
    of_first: InnovationsModel,
    held_back: HeldBack,
    rate_hz: int,
    as_it_is: Tried | None = None,
) -> tuple[InnovationsModel, dict[float, float]]:
    """Return ``model`` with level step and scale, and errors by level step.

    ``of_first`` is of the rows before, ``as_it_is`` what `try_model` said of it, if it was asked.
    """
    steps_tried = (of_first.level_step,) if of_first.integrated else LEVEL_STEPS
    tried = {
        step: as_it_is
        if as_it_is is not None and step == of_first.level_step
        else try_model(replace(of_first, level_step=step), held_back, rate_hz)
        for step in steps_tried
    }
    level_step = min(tried, key=lambda step: tried[step].error)
    steps, scale = covariance_scale(held_back.outputs, tried[level_step], rate_hz)
    found = replace(model, level_step=level_step, scale_horizons=steps, covariance_scale=scale)
    return found, {step: each.error for step, each in tried.items()}


def covariance_scale(outputs: Sequence[Array], tried: Tried, rate_hz: int) -> tuple[Array, Array]:
    """Return horizons in samples, and by what covariances at the activity of the time are too small there.

    It is `coverage_factor` over all rows but the first 2 s of each trial.
    """
    rows = _settled_rows(outputs, rate_hz)
    means, activities = rows.run(tried.filter, tried.unbroken, ActivityMean.at_rate(rate_hz))
    covariance = tried.unbroken.covariances[tried.unbroken.stage(max(map(len, outputs)) // 2)]
    steps = np.unique(np.round(np.geomspace(1, tried.filter.horizon, _N_SCALES)).astype(int))
    scale = []
    for h in steps.tolist():
        errors = np.concatenate(rows.forecast_errors(tried.filter, means, h))
        errors /= np.sqrt(np.concatenate([activity[:-h] for activity in activities]))[:, None]
        scale.append(coverage_factor(errors, tried.filter.spread(covariance, h, 0.0), h))
    return steps.astype(float), np.array(scale)
