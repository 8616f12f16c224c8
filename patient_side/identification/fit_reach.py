"""The dependence of forecasts on the phase of a reach: a regression of a linear model's errors on training rows.

Errors over a horizon overlap, and the phase of a reach persists: among the errors within a horizon and a third of a
second only one is independent. The prior assumes that a regressor explains at most some 30 % of the error's
deviation, and ever less beyond a second: the reach is then over, and a few minutes' movement would show chance
correlations only. The gripper's prior is a third of that, and narrower still in proportion to its fewer independent
errors, as a gripper stays open or closed for longer.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from patient_side.filters.innovations_filter import InnovationsFilter
from patient_side.filters.reach import N_PARTS, N_TERMS, log_speed, openness, phases, terms
from patient_side.statespace import Array, Reach

_SPAN_S = 0.1
_PRIOR = 0.3
_GRIPPER_PRIOR = 0.1
_REACH_S = 1.0
_ALIKE_S = 1 / 3
_OUTER = 0.005
"""Share of the training rows' speeds at either end that are clipped to the range of the others."""
_N_BLOCKS = 6
"""Blocks of rows for cross-validation: errors come from coefficients fitted without their own block."""


@dataclass(frozen=True)
class FittedReach:
    """The coefficients, and the cross-validated forecast errors (M_i, 3), by horizon and trial."""

    reach: Reach
    errors: list[list[Array]]


def reach_span(rate_hz: int) -> int:
    """Return the number of samples that a hand's velocity is averaged over; its acceleration takes twice as many."""
    return max(1, round(_SPAN_S * rate_hz))


def fit_reach(
    outputs: Sequence[Array],
    means: Sequence[Array],
    activities: Sequence[Array],
    sizes: Sequence[float],
    filter_: InnovationsFilter,
    steps: NDArray[np.int64],
    rate_hz: int,
    grippers_rad: Sequence[Array] = (),
) -> FittedReach:
    """Return the dependence of forecasts over ``steps`` (H,) samples on the phase of the reach.

    ``outputs`` (M_i, 3) are positions in m, ``means`` (M_i, N) and ``activities`` (M_i,) the filter's at these rows.
    ``grippers_rad`` (M_i,) are the grippers' angles there; without them the openings are 0.
    Trials are weighted by the inverse of their ``sizes``: otherwise the liveliest trial dominates. Oracles in
    test_fit_reach: numpy's least squares with the prior as rows, minimum-jerk reaches, and a linear process, on which
    the coefficients must vanish.
    """
    # The phase at every row, its speed in units of the usual one, and the terms of the coefficients.
    span = reach_span(rate_hz)
    found = [phases(filter_, span, m, a, 1.0) for m, a in zip(means, activities, strict=True)]
    usual_m = max(float(np.sqrt(np.mean(np.concatenate([each.speed for each in found]) ** 2))), 1e-12)
    found = [each._replace(speed=each.speed / usual_m) for each in found]
    lowest, highest = np.quantile(log_speed(np.concatenate([each.speed for each in found])), (_OUTER, 1 - _OUTER))
    angles = grippers_rad or [np.zeros(len(y)) for y in outputs]
    together = np.concatenate(list(angles))
    usual_rad, spread_rad = float(together.mean()), float(together.std())
    openings = [openness(each, usual_rad, spread_rad) for each in angles]
    held = _rows_held(openings)
    varying = [terms(each, opening, lowest, highest) for each, opening in zip(found, openings, strict=True)]
    # One regression for each horizon.
    n_blocks = -(-_N_BLOCKS // len(outputs))
    weights, errors = np.zeros((len(steps), N_PARTS, N_TERMS)), []
    for j, h in enumerate(steps.tolist()):
        rows = []
        for y, state, phase, term, size in zip(outputs, means, found, varying, sizes, strict=True):
            n = max(0, len(y) - h)
            move = state[:n] @ filter_.outputs[h].T - y[:n]
            parts = np.stack([move, phase.velocity[:n], phase.to_level[:n]], axis=1)
            rows.append(_Rows(parts, term[:n], y[h : h + n] - y[:n] - move, 1.0 / size**2))
        n_alike = h + _ALIKE_S * rate_hz
        prior = np.full(N_TERMS, _PRIOR)
        prior[-1] = _GRIPPER_PRIOR * sqrt(min(1.0, n_alike / held))
        prior *= min(1.0, _REACH_S * rate_hz / h) ** 2
        weights[j], left = _regress(rows, n_alike, prior, n_blocks)
        errors.append(left)
    reach = Reach(span, usual_m, float(lowest), float(highest), usual_rad, spread_rad, steps.astype(float), weights)
    return FittedReach(reach, errors)


def _rows_held(openings: Sequence[Array]) -> float:
    """Return the mean number of rows for which a gripper stays open or closed."""
    n_changes = sum(int(np.count_nonzero(np.diff(each > 0))) for each in openings)
    return sum(map(len, openings)) / (n_changes + 1)


@dataclass(frozen=True)
class _Rows:
    """Parts (M, 3, 3), terms (M, 7), residuals of the linear forecast (M, 3), and the weight of all rows."""

    parts: Array
    terms: Array
    left: Array
    weight: float

    def without(self, coefficients: Array) -> Array:
        """Return the residuals (M, 3) with coefficients (3, 7)."""
        return np.asarray(self.left - np.einsum("mi,mia->ma", self.terms @ coefficients.T, self.parts))


@dataclass(frozen=True)
class _Moments:
    """Second moments: of the 21 regressors, of these with the errors, of the errors; and the number of errors."""

    past: Array
    cross: Array
    square: float
    n: int

    def less(self, other: "_Moments") -> "_Moments":
        return _Moments(
            self.past - other.past, self.cross - other.cross, self.square - other.square, self.n - other.n
        )

    def coefficients(self, n_alike: float, prior: Array) -> Array:
        """Return the coefficients (3, 7) for a prior deviation of ``prior`` (7,) times the errors' for each term.

        ``n_alike`` successive errors are as informative as one independent error.
        """
        size = np.sqrt(np.diag(self.past))
        if self.n <= 0 or self.square <= 0 or not np.all(np.isfinite(size)):
            return np.zeros((N_PARTS, N_TERMS))
        # Regressors in units of the errors; one that vanishes gets the coefficient 0.
        unit = np.divide(np.sqrt(self.square), size, out=np.zeros_like(size), where=size > 0)
        scale = self.n / (self.square * n_alike)
        normal = scale * unit[:, None] * self.past * unit + np.diag(np.tile(prior**-2.0, N_PARTS))
        return np.asarray((unit * np.linalg.solve(normal, scale * unit * self.cross)).reshape(N_PARTS, N_TERMS))


def _regress(rows: Sequence[_Rows], n_alike: float, prior: Array, n_blocks: int) -> tuple[Array, list[Array]]:
    """Return the coefficients (3, 7) of all rows, and by trial the residuals with those of the other blocks."""
    blocks = [[_block(each, cut) for cut in _cuts(len(each.left), n_blocks)] for each in rows]
    moments = [[_moments(each) for each in of_trial] for of_trial in blocks]
    whole = _sum([each for of_trial in moments for each in of_trial])
    left = []
    for of_trial, own in zip(blocks, moments, strict=True):
        others = [whole.less(each).coefficients(n_alike, prior) for each in own]
        left.append(np.concatenate([each.without(by) for each, by in zip(of_trial, others, strict=True)]))
    return whole.coefficients(n_alike, prior), left


def _cuts(n_rows: int, n_blocks: int) -> list[slice]:
    ends = np.linspace(0, n_rows, n_blocks + 1).astype(int)
    return [slice(first, last) for first, last in pairwise(ends.tolist())]


def _block(rows: _Rows, cut: slice) -> _Rows:
    return _Rows(rows.parts[cut], rows.terms[cut], rows.left[cut], rows.weight)


def _moments(rows: _Rows) -> _Moments:
    """Return the moments of the regressors ``term x part``, from row-wise products of parts and of terms."""
    size = N_PARTS * N_TERMS
    weighted = rows.weight * rows.parts
    of_parts = np.matmul(weighted, rows.parts.transpose(0, 2, 1)).reshape(-1, N_PARTS**2)
    of_terms = (rows.terms[:, :, None] * rows.terms[:, None, :]).reshape(-1, N_TERMS**2)
    past = (of_parts.T @ of_terms).reshape(N_PARTS, N_PARTS, N_TERMS, N_TERMS).transpose(0, 2, 1, 3)
    cross = np.matmul(weighted, rows.left[:, :, None])[:, :, 0].T @ rows.terms
    square = rows.weight * float(np.sum(rows.left**2))
    return _Moments(past.reshape(size, size), cross.reshape(size), square, rows.left.size)


def _sum(moments: Sequence[_Moments]) -> _Moments:
    return _Moments(
        np.sum([each.past for each in moments], axis=0),
        np.sum([each.cross for each in moments], axis=0),
        sum(each.square for each in moments),
        sum(each.n for each in moments),
    )
