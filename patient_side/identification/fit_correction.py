"""The correction of a linear forecast by the state of the hand's movement: two regressions of its errors.

First the coefficients that vary, then, on what they leave, the weights of the Fourier features. Both are ridge
regressions from accumulated second moments, whose priors say how much of an error may be explained. Errors over a
horizon overlap, and a movement persists: among the errors within a horizon and a third of a second only one is
independent. A coefficient's regressor is assumed to explain at most some 60 % of the errors' deviation, and ever less
beyond a second: the reach is then over, and a few minutes' movement would show chance correlations only. The
gripper's prior is narrower, in proportion to its fewer independent errors, as a gripper stays open or closed for
longer. All Fourier features together may explain 30 % of the variance.

Rows are held out by person where there are several, otherwise by recording or by stretches. Errors of rows held out
measure what a correction is worth: each is multiplied by the share that they support, less half the standard error of
that share. With little training data the share falls to 0, and the forecast is the linear one.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.correction import N_MOVEMENT_TERMS
from tis.patient_side.filters.innovations_filter import AXES, InnovationsFilter
from tis.patient_side.identification.correction_rows import (
    N_FEATURES,
    CorrectionRows,
    PreparedRows,
    short,
    without_weights,
)
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import N_PARTS, N_TERMS, Correction

# Ridge regressions from second moments: sums over rows, by groups that are held out together.


class Moments(NamedTuple):
    """Second moments of regressors (G, K, K), with the errors (G, K, R), of the errors (G,), by group, and counts."""

    past: Array
    cross: Array
    square: Array
    n: Array


def ridge(past: Array, cross: Array, square: float, n: float, precision: Array) -> Array:
    """Return the ridge solution (K, R) from second moments of regressors, with the errors, and of the errors.

    ``precision`` (K,) is the inverse variance of a coefficient's prior, times the rows that are alike, for regressors
    and errors in units of their deviations.
    """
    size = np.sqrt(np.diag(past))
    if n <= 0 or square <= 0 or not np.all(np.isfinite(size)):
        return np.zeros_like(cross)
    # Regressors in units of the errors; one that vanishes gets the coefficient 0.
    unit = np.divide(sqrt(square), size, out=np.zeros_like(size), where=size > 0)
    normal = (n / square) * unit[:, None] * past * unit + np.diag(precision)
    return np.asarray(unit[:, None] * np.linalg.solve(normal, (n / square) * unit[:, None] * cross))


def solutions(moments: Moments, precision: Array) -> tuple[Array, list[Array]]:
    """Return the `ridge` solutions (K, R) of all rows, and for each group of the rows outside it."""
    total = Moments(*(each.sum(axis=0) for each in moments))
    by_group = [
        ridge(total.past - past, total.cross - cross, float(total.square - square), float(total.n - n), precision)
        for past, cross, square, n in zip(*moments, strict=True)
    ]
    return ridge(total.past, total.cross, float(total.square), float(total.n), precision), by_group


def empty_moments(n_groups: int, size: int, n_errors: int) -> Moments:
    """Return moments of no rows, of ``size`` regressors with ``n_errors`` errors."""
    return Moments(
        np.zeros((n_groups, size, size)), np.zeros((n_groups, size, n_errors)), np.zeros(n_groups), np.zeros(n_groups)
    )


Features = NDArray[np.float32]

_PRIOR = 0.6
_GRIPPER_PRIOR = 0.1
_TOGETHER = 0.3
_DOUBT = 0.5
"""Standard errors by which the supported share of a correction is reduced."""
_REACH_S = 1.0
_ALIKE_S = 1 / 3
_STRETCH_S = 4
_WORTH_IT = 0.99
"""Ratio of squared errors, with the Fourier features to without, up to which they are used."""


@dataclass(frozen=True)
class FittedCorrection:
    """The correction, and forecast errors (M_i, 3) by horizon and trial: of rows held out, and without correction.

    ``stage`` has the rows; ``parts`` (G + 1, 8, 15) and ``features`` (G + 1, 128, 3) are, by horizon, the weights
    without each group of rows, and of all rows.
    """

    correction: Correction
    errors: list[list[Array]]
    linear_errors: list[list[Array]]
    stage: "Stage"
    parts: list[Array]
    features: list[Array]

    def left_without(self, j: int, h: int, every: int) -> list[Array]:
        """Return what the weights of each world leave of every so many rows by trial (M, G + 1, 3), over h samples.

        In the g-th world nobody has seen group g; the last has seen all. Unlike errors of rows held out, those of
        other groups do not depend on group g there: what is learned from them may be judged by it.
        """
        found = []
        for trial in self.stage.trials:
            move, error = (each[::every] for each in trial.forecast(self.stage.filter, h))
            n = len(error)
            parts = np.concatenate([move[:, None], trial.parts[::every][:n]], axis=1)
            coefficients = np.matmul(self.parts[j], trial.terms[::every][:n].T).transpose(2, 0, 1)
            added = trial.features[::every][:n] @ self.features[j].transpose(1, 0, 2).reshape(N_FEATURES, -1)
            left = error[:, None] - np.matmul(coefficients, parts)
            found.append((left - added.reshape(n, -1, AXES)).astype(np.float32))
        return found


def fit_correction(
    trials: Sequence[CorrectionRows], filter_: InnovationsFilter, steps: NDArray[np.int64], rate_hz: int
) -> FittedCorrection:
    """Return the correction of forecasts over ``steps`` (H,) samples, in order.

    Rows count in units of their hand's activity: otherwise the liveliest trial dominates. The Fourier features are
    drawn once, from a fixed stream, so that the same rows give the same correction. Oracles in test_fit_correction:
    numpy's least squares with the prior as rows, minimum-jerk reaches, rows of an uneven clock, and a linear process,
    on which the correction must vanish.
    """
    model = without_weights(trials, filter_, rate_hz)
    prepared = [PreparedRows.of(each, model, filter_) for each in trials]
    n_groups = 1 + max((int(each.group.max()) for each in trials if len(each.group)), default=0)
    held = _rows_held([each.terms[:, N_MOVEMENT_TERMS - 1] for each in prepared])
    stage = Stage(prepared, filter_, n_groups, round(_STRETCH_S * rate_hz))
    # The coefficients, and what they leave on rows held out.
    moments = stage.moments_of_parts(steps)
    weights, left, by_world = np.zeros((len(steps), N_PARTS, N_TERMS)), [], []
    for j, h in enumerate(steps.tolist()):
        prior = np.full(N_TERMS, _PRIOR)
        prior[N_MOVEMENT_TERMS - 1] = _GRIPPER_PRIOR * sqrt(min(1.0, (h + _ALIKE_S * rate_hz) / held))
        prior *= min(1.0, _REACH_S * rate_hz / h) ** 2
        precision = (h + _ALIKE_S * rate_hz) * np.tile(prior**-2.0, N_PARTS)
        whole, by_group = solutions(moments[j], precision)
        share, residuals = stage.left_of_parts(h, by_group)
        weights[j] = share * whole.reshape(N_PARTS, N_TERMS)
        by_world.append(share * np.stack([*by_group, whole]).reshape(-1, N_PARTS, N_TERMS))
        left.append(residuals)
    # The Fourier features on these residuals.
    features = [each.features for each in prepared]
    of_features = stage.moments_of_features(features, left)
    fourier = np.zeros((len(steps), AXES, N_FEATURES))
    of_world = [np.zeros((n_groups + 1, N_FEATURES, AXES)) for _ in steps]
    for j, h in enumerate(steps.tolist()):
        precision = np.full(N_FEATURES, (h + _ALIKE_S * rate_hz) * N_FEATURES / _TOGETHER)
        precision /= min(1.0, _REACH_S * rate_hz / h)
        whole, by_group = solutions(of_features[j], precision)
        share, residuals = stage.left_of_features(features, left[j], by_group)
        # Features cost as much time as all the rest: where they gain next to nothing they are left out.
        if _squares(residuals) <= _WORTH_IT * _squares(left[j]):
            fourier[j], left[j] = share * whole.T, residuals
            of_world[j] = share * np.stack([*by_group, whole])
    correction = replace(
        model,
        horizons=steps.astype(float),
        weights=short(weights),
        fourier=short(fourier),
        linear_scale=np.ones(len(steps)),
    )
    linear = [[each.forecast(filter_, h)[1] for each in prepared] for h in steps.tolist()]
    errors, linear_errors = (
        [[e * of.unit[: len(e), None] for e, of in zip(each, prepared, strict=True)] for each in each_stage]
        for each_stage in (left, linear)
    )
    return FittedCorrection(correction, errors, linear_errors, stage, by_world, of_world)


def _squares(errors: Sequence[Array]) -> float:
    return sum(float(np.sum(error**2)) for error in errors)


def _rows_held(openings: Sequence[Array]) -> float:
    """Return the mean number of rows for which a gripper stays open or closed."""
    n_changes = sum(int(np.count_nonzero(np.diff(each > 0))) for each in openings)
    return sum(map(len, openings)) / (n_changes + 1)


@dataclass(frozen=True)
class Stage:
    """The regressions' rows: all trials, and how they are held out and compared."""

    trials: list[PreparedRows]
    filter: InnovationsFilter
    n_groups: int
    stretch: int

    def moments_of_parts(self, steps: NDArray[np.int64]) -> list[Moments]:
        """Return for each horizon the moments of the regressors ``part x term`` (120).

        The parts but the forecast move are those of every horizon: their moments are summed once, over all rows, and
        those of the rows that a horizon leaves without a future are taken off.
        """
        size, G = N_PARTS * N_TERMS, self.n_groups
        found = [empty_moments(G, size, 1) for _ in steps]
        for trial in self.trials:
            pairs = trial.terms[:, :, None] * trial.terms[:, None, :]
            pairs = pairs.reshape(len(pairs), -1)
            for group, own in trial.blocks:
                alone = _products(trial.parts[own], trial.parts[own], pairs[own])
                for j, h in enumerate(steps.tolist()):
                    n = min(own.stop, max(0, len(trial.unit) - h))
                    if n <= own.start:
                        continue
                    with_future = slice(own.start, n)
                    tail = slice(n, own.stop)
                    others = alone - _products(trial.parts[tail], trial.parts[tail], pairs[tail])
                    move, error = (each[with_future] for each in trial.forecast(self.filter, h))
                    parts = np.concatenate([move[:, None], trial.parts[with_future]], axis=1)
                    of_move = _products(move[:, None], parts, pairs[with_future])[0]
                    found[j].past[group] += _assembled(of_move, others)
                    cross = np.einsum("mpa,ma->mp", parts, error).T @ trial.terms[with_future]
                    found[j].cross[group] += cross.reshape(size, 1)
                    found[j].square[group] += float(np.sum(error**2))
                    found[j].n[group] += error.size
        return found

    def left_of_parts(self, h: int, by_group: list[Array]) -> tuple[float, list[Array]]:
        """Return the coefficients' share, and what they leave on rows held out, by trial."""
        errors, corrections = [], []
        for trial in self.trials:
            move, error = trial.forecast(self.filter, h)
            n = len(move)
            parts = np.concatenate([move[:, None], trial.parts[:n]], axis=1)
            correction = np.zeros_like(error)
            for group, own in trial.blocks:
                coefficients = trial.terms[:n][own] @ by_group[group].reshape(N_PARTS, N_TERMS).T
                correction[own] = np.matmul(coefficients[:, None], parts[own])[:, 0]
            errors.append(error)
            corrections.append(correction)
        return self.shared(errors, corrections)

    def moments_of_features(self, of_trials: Sequence[Features], left: list[list[Array]]) -> list[Moments]:
        """Return for each horizon the moments of the trials' features (M, K) with what is ``left``."""
        size = of_trials[0].shape[1]
        found = [empty_moments(self.n_groups, size, AXES) for _ in left]
        for i, (trial, features) in enumerate(zip(self.trials, of_trials, strict=True)):
            for group, own in trial.blocks:
                first, last = own.start, own.stop
                alone = features[first:last].T @ features[first:last]
                for j, each in enumerate(left):
                    n = min(last, len(each[i]))
                    if n <= first:
                        continue
                    error, tail = each[i][first:n], features[n:last]
                    found[j].past[group] += alone - tail.T @ tail
                    found[j].cross[group] += features[first:n].T @ error.astype(np.float32)
                    found[j].square[group] += float(np.sum(error**2)) / AXES
                    found[j].n[group] += len(error)
        return found

    def left_of_features(
        self, of_trials: Sequence[Features], left: list[Array], by_group: list[Array]
    ) -> tuple[float, list[Array]]:
        """Return the features' share, and what they leave on rows held out, by trial."""
        corrections = []
        for trial, each, error in zip(self.trials, of_trials, left, strict=True):
            features, correction = each[: len(error)], np.zeros_like(error)
            for group, own in trial.blocks:
                correction[own] = features[own] @ by_group[group].astype(np.float32)
            corrections.append(correction)
        return self.shared(left, corrections)

    def shared(self, errors: list[Array], corrections: list[Array]) -> tuple[float, list[Array]]:
        """Return the share of the corrections that the errors support, and the errors less that share.

        It is the regression of errors on corrections less half its standard error, from sums over stretches of 4 s.
        """
        products, square = [], 0.0
        for error, correction in zip(errors, corrections, strict=True):
            if len(error):
                of_row = np.sum(error * correction, axis=1)
                products.append(np.add.reduceat(of_row, np.arange(0, len(of_row), self.stretch)))
                square += float(np.sum(correction**2))
        if not products or square <= 0.0:
            return 0.0, errors
        sums = np.concatenate(products)
        deviation = float(np.std(sums)) * sqrt(len(sums))
        share = max(0.0, min(1.0, (float(sums.sum()) - _DOUBT * deviation) / square))
        return share, [error - share * each for error, each in zip(errors, corrections, strict=True)]


def _products(one: Array, other: Array, pairs: Array) -> Array:
    """Return the moments (P, Q, T, T) of parts (M, P, 3) and (M, Q, 3), times ``pairs`` (M, T T) of terms."""
    of_parts = np.matmul(one, other.transpose(0, 2, 1))
    n_one, n_other = of_parts.shape[1:]
    flat = of_parts.reshape(len(one), n_one * n_other).T @ pairs
    return np.asarray(flat.reshape(n_one, n_other, N_TERMS, N_TERMS))


def _assembled(of_move: Array, others: Array) -> Array:
    """Return the moments (120, 120) from those of the move (8, T, T) and of the other parts (7, 7, T, T)."""
    whole = np.empty((N_PARTS, N_PARTS, N_TERMS, N_TERMS))
    whole[0], whole[1:, 0], whole[1:, 1:] = of_move, of_move[1:], others
    return whole.transpose(0, 2, 1, 3).reshape(N_PARTS * N_TERMS, -1)
