"""Identification of the models of an arm's orientation and gripper."""

from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from typing import Final

import numpy as np

from tis.common.errors import DataError
from tis.patient_side.filters.input_path import damped_steps
from tis.patient_side.identification.coverage import coverage_factor, independent_windows, prediction_factor
from tis.patient_side.identification.dataset import TrainingSet
from tis.patient_side.identification.direct_ls import RESOLUTION, STEP_HZ, Moved, differences, fit_direct, steps_of
from tis.patient_side.identification.forecast import DAMPINGS, HORIZONS_S, SPANS, relative_error
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import RateModel, WristModel
from tis.patient_side.rotations import turned

# Identification of damped rates, for orientations and grippers.
#
# ``y[k+h]`` is forecast as y[k] moved by ``v sum_i phi^i``, i = 1..h, with v the mean movement per step over the last
# ``span`` steps: the damped trend of Gardner and McKenzie (1985), without smoothing, in a space with displacements.

_N_FITTED: Final = 1
"""The damping, which all axes share."""


def fit_rate(signals: Sequence[Array], rate_hz: int, moved: Moved) -> RateModel:
    """Return damping and span of the best forecast of the signals (N, v), and the covariances of its errors.

    The criterion is that of `fit_forecast`: the mean over horizons up to 2 s of the squared error over hold's. The
    horizons of the covariances are those of `direct_ls`; the factors of `coverage_factor` and `prediction_factor`
    make 95 % ellipsoids hold 95 % of new errors. Oracles in test_fit_rate: a plain loop, and a constant rate.
    """
    stride = max(1, round(rate_hz / STEP_HZ))
    longest = max((len(y) for y in signals), default=0) // stride
    horizons = steps_of(longest // 4) or [1]
    scored = sorted({max(1, round(s * STEP_HZ)) for s in HORIZONS_S if s * STEP_HZ <= horizons[-1]}) or [1]
    # The rates over each span, at the same samples for all, and the movements ahead.
    best, damping, span = np.inf, 0.0, SPANS[0]
    for tried in SPANS:
        costs = []
        for horizon in scored:
            rates, ahead = _pairs(signals, tried, horizon, max(SPANS), stride, moved)
            sums = float(np.sum(ahead**2)), float(np.sum(ahead * rates)), float(np.sum(rates**2))
            costs.append(relative_error(DAMPINGS, 1.0, horizon, sums))
        cost = np.mean(costs, axis=0)
        at = int(np.argmin(cost))
        if cost[at] < best:
            best, damping, span = float(cost[at]), float(DAMPINGS[at]), tried
    covariances = [_covariance(signals, damping, span, h, stride, moved) for h in horizons]
    return RateModel(stride, damping, span, np.array(horizons, dtype=float), np.array(covariances))


def _pairs(
    signals: Sequence[Array], span: int, horizon: int, first: int, stride: int, moved: Moved
) -> tuple[Array, Array]:
    """Return the rates per step and the movements ahead, (rows, d) each, of all samples from step ``first`` on."""
    rates, ahead = [], []
    for y in signals:
        now = np.arange(first * stride, max(first * stride, len(y) - horizon * stride))
        rates.append(-moved(y[now], y[now - span * stride]) / span)
        ahead.append(moved(y[now], y[now + horizon * stride]))
    return np.concatenate(rates), np.concatenate(ahead)


def _covariance(
    signals: Sequence[Array], damping: float, span: int, horizon: int, stride: int, moved: Moved
) -> Array:
    rates, ahead = _pairs(signals, span, horizon, span, stride, moved)
    errors = ahead - damped_steps(damping, horizon) * rates
    axes = errors.shape[-1]
    covariance = errors.T @ errors / max(1, len(errors)) + RESOLUTION**2 * np.eye(axes)
    steps = horizon * stride
    windows = independent_windows(len(errors), steps)
    by_chance = prediction_factor(windows, _N_FITTED / axes, axes=axes)
    return np.asarray(by_chance * coverage_factor(errors, covariance, steps) * covariance)


def fit_wrist(
    training: TrainingSet, wanted: Collection[str] | None, stage: Callable[[str], AbstractContextManager[None]]
) -> tuple[WristModel | None, tuple[str, ...]]:
    """Return the models for the orientation methods ``wanted`` (None: all), and warnings; None: none is wanted.

    Trials too short for least squares give no such model and a warning: the answers then hold the orientation.
    ``stage`` measures each fit.
    """
    orientations, rate_hz = training.orientations, training.rate_hz
    grippers = [angles[:, None] for angles in training.grippers_rad]
    rate = gripper_rate = direct = gripper_direct = None
    warnings: tuple[str, ...] = ()
    if wanted is None or "constant_rate" in wanted:
        with stage("constant_rate"):
            rate = fit_rate(orientations, rate_hz, turned)
            gripper_rate = fit_rate(grippers, rate_hz, differences)
    if wanted is None or "tangent_ls" in wanted:
        try:
            with stage("tangent_ls"):
                direct = fit_direct(orientations, rate_hz, turned)
                gripper_direct = fit_direct(grippers, rate_hz)
        except DataError as error:
            warnings = (f"no model for tangent_ls: {'; '.join(map(str, error.faults))}",)
    if rate is None and direct is None:
        return None, warnings
    return WristModel(rate, gripper_rate, direct, gripper_direct), warnings
