"""Multi-horizon least squares: one regression for each horizon, from past to future directly.

The training rows are reduced to their second moments: see `second_moments`. Cross-validation selects for each horizon
the shrinkage towards holding the last position and the number of lags: see `cautious_choice`.

Second moments of a signal's past and future, and least squares on them.

A sample's past is the signal some steps ago relative to it, its future that some steps ahead: of an arm's position
the differences, of its orientation the rotation vectors. Least squares on a subset of the regressors needs the
subset's moments only, so one set of moments serves any pattern of arrived samples. Both arms' rows may be pooled, as
only displacements matter.

The regularisation adds the moments of a random walk with independent steps, ``penalty`` times the mean square step.
It thus has the same meaning for every subset, reduces the influence of fine detail, and in the limit leaves only the
last position: hold.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.patient_side.identification.coverage import coverage_factor, independent_windows, prediction_factor
from tis.patient_side.identification.noise import SENSOR_RESOLUTION_M
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import DirectModel

RESOLUTION: Final = SENSOR_RESOLUTION_M
"""Resolution of all signals in their SI unit: recordings have six decimals of metres, radians and of rotations."""

Moved = Callable[[Array, Array], Array]
"""Returns the displacements (..., d) from values (..., v) to others (..., v), broadcast."""


def differences(now: Array, other: Array) -> Array:
    """Return the displacements of a signal in a vector space."""
    return np.asarray(other - now)


@dataclass(frozen=True)
class Moments:
    """Second moments of pasts z (d L,) and futures (H, d): means over ``n_rows`` rows."""

    past: Array
    cross: Array
    future: Array
    n_rows: int

    @property
    def axes(self) -> int:
        """Number of axes d."""
        return int(self.future.shape[-1])

    def weights(self, walk: Array, penalty: float, n_past: int) -> Array:
        """Return the weights (n_past, d H) on a past's first elements, for all horizons at once."""
        cross = self.cross[:, :n_past].transpose(1, 0, 2).reshape(n_past, -1)
        return np.asarray(np.linalg.solve(self.past[:n_past, :n_past] + penalty * walk[:n_past, :n_past], cross))

    def squares_left(self, weights: Array) -> Array:
        """Return the residual sum of squares (H,) per row of these futures, with weights from any rows."""
        n_past, n_horizons = len(weights), len(self.future)
        by_horizon = weights.reshape(n_past, n_horizons, self.axes)
        known = np.einsum("dhi,hdi->h", by_horizon, self.cross[:, :n_past])
        return np.asarray(np.trace(self.future, axis1=1, axis2=2) - 2 * known + self.squares_moved(weights))

    def squares_moved(self, weights: Array) -> Array:
        """Return the sum of squares (H,) per row of the moves forecast with these weights."""
        n_past, n_horizons = len(weights), len(self.future)
        products = weights * (self.past[:n_past, :n_past] @ weights)
        return np.asarray(products.reshape(n_past, n_horizons, self.axes).sum(axis=(0, 2)))


def pooled(parts: Sequence[Moments]) -> Moments:
    """Return the moments of all rows of the parts; at least one part must have rows."""
    counts = np.array([part.n_rows for part in parts])

    def mean(each: list[Array]) -> Array:
        return np.asarray(np.tensordot(counts / counts.sum(), np.stack(each), 1))

    past, cross = mean([part.past for part in parts]), mean([part.cross for part in parts])
    return Moments(past, cross, mean([part.future for part in parts]), int(counts.sum()))


def windows(
    outputs: Sequence[Array],
    lags: NDArray[np.int64],
    horizons: NDArray[np.int64],
    stride: int,
    moved: Moved = differences,
) -> tuple[Array, Array]:
    """Return pasts (rows, d L) and futures (rows, H, d), relative to their sample, of all rows that have both.

    At least one of the ``outputs`` (N, v) is expected; ``moved`` returns the displacements between their rows.
    """
    back, ahead = int(lags[-1]) * stride, int(horizons[-1]) * stride
    pasts, futures = [], []
    for y in outputs:
        now = np.arange(back, max(back, len(y) - ahead))
        past = moved(y[now, None], y[now[:, None] - lags * stride])
        pasts.append(past.reshape(len(now), len(lags) * past.shape[-1]))
        futures.append(moved(y[now, None], y[now[:, None] + horizons * stride]))
    return np.concatenate(pasts), np.concatenate(futures)


def moments(
    outputs: Sequence[Array],
    lags: NDArray[np.int64],
    horizons: NDArray[np.int64],
    stride: int,
    n_parts: int,
    moved: Moved = differences,
) -> list[Moments]:
    """Return the second moments of `windows`, in ``n_parts`` parts of equally many rows, one after another.

    They are summed trial by trial, so that memory holds one trial at a time.
    """
    axes = moved(outputs[0][:1], outputs[0][:1]).shape[-1]
    d, n_horizons = axes * len(lags), len(horizons)
    first_rows = np.cumsum([0] + [max(0, len(y) - int(lags[-1] + horizons[-1]) * stride) for y in outputs])
    borders = np.linspace(0, first_rows[-1], n_parts + 1).astype(int)
    past, cross = np.zeros((n_parts, d, d)), np.zeros((n_parts, n_horizons, d, axes))
    future = np.zeros((n_parts, n_horizons, axes, axes))
    for y, first in zip(outputs, first_rows[:-1], strict=True):
        pasts, futures = windows([y], lags, horizons, stride, moved)
        for part in range(n_parts):
            begin, end = np.clip(borders[part : part + 2] - first, 0, len(pasts))
            z, t = pasts[begin:end], futures[begin:end]
            if len(z):
                past[part] += z.T @ z
                cross[part] += (z.T @ t.reshape(len(t), -1)).reshape(d, n_horizons, axes).transpose(1, 0, 2)
                future[part] += np.einsum("khi,khj->hij", t, t)
    sizes = np.diff(borders)
    sums = zip(past, cross, future, sizes, strict=True)
    return [Moments(p / max(1, n), c / max(1, n), f / max(1, n), int(n)) for p, c, f, n in sums]


def random_walk(past: Array, lags: NDArray[np.int64]) -> Array:
    """Return the moments (d L, d L) of a random walk with the mean step of ``past`` (d L, d L) on every axis."""
    axes = len(past) // len(lags)
    square = max(float(np.trace(past[:axes, :axes])) / axes, RESOLUTION**2)
    return np.asarray(np.kron(square * np.minimum.outer(lags, lags), np.eye(axes)))


def regression(
    found: Moments | DirectModel, walk: Array, penalty: float, horizon: int, kept: slice | NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return the weights (kept, d) on some of a past's elements, and the residual moment (d, d).

    ``horizon`` is the position of the horizon. The moment includes the sensor's resolution as a floor.
    """
    past, cross, future = found.past[kept][:, kept], found.cross[horizon][kept], found.future[horizon]
    weights = np.linalg.solve(past + penalty * walk[kept][:, kept], cross)
    explained = weights.T @ cross
    left = future - explained - explained.T + weights.T @ past @ weights
    return weights, (left + left.T) / 2 + RESOLUTION**2 * np.eye(len(future))


# Model selection for the regressions of `direct_ls`: the most cautious candidate that cross-validation supports.
#
# The smallest of many errors is partly chance, the more so the fewer movements the rows hold. The standard-error
# rule (Breiman, Friedman, Olshen and Stone, *Classification and Regression Trees*, 1984, 3.4.3) selects the most
# cautious candidate whose error is hardly above the smallest: here within half a standard error, as each horizon's
# errors are averaged with those up to an octave away, which removes most of the chance. The most cautious candidate
# forecasts the smallest moves: with few rows it approaches hold, with many rows the caution vanishes.

_OCTAVES = 1.0
_STANDARD_ERRORS = 0.5


@dataclass(frozen=True)
class Candidate:
    """Number of lags and penalty of a regression."""

    n_lags: int
    penalty: float


def most_cautious(
    parts: Sequence[Moments], walk: Array, candidates: Sequence[Candidate], steps: NDArray[np.int64]
) -> list[Candidate]:
    """Return the selected candidate at each horizon of ``steps`` (H,) samples; at least two ``parts`` must have rows.

    The parts are runs of rows, not rows drawn at random, as neighbouring rows share most of their movement; each is
    left out in turn, together with as many of its neighbours as the horizon reaches into (h-block cross-validation:
    Burman, Chow and Nolan, 1994). The standard error is that of the mean over the parts, for the difference to the
    best candidate, as a difficult part is difficult for all candidates. Oracles: rows left out one part after
    another, and a random walk.
    """
    # For each width of the gap, the moments of all rows outside it.
    parts = [part for part in parts if part.n_rows]
    whole, places = pooled(parts), np.arange(len(parts))
    gaps = np.minimum(np.rint(steps * len(parts) / whole.n_rows).astype(int), len(parts) // 2 - 1)
    others = {
        gap: [pooled([parts[i] for i in np.flatnonzero(np.abs(places - place) > gap)]) for place in places]
        for gap in set(gaps.tolist())
    }
    # Errors on the parts left out, and sizes of the forecast moves on all rows.
    errors, moved = np.empty((len(candidates), len(parts), len(steps))), np.empty((len(candidates), len(steps)))
    for c, candidate in enumerate(candidates):
        fit = walk, candidate.penalty, whole.axes * candidate.n_lags
        moved[c] = whole.squares_moved(whole.weights(*fit))
        for gap, fitted in others.items():
            for place, (part, other) in enumerate(zip(parts, fitted, strict=True)):
                errors[c, place, gaps == gap] = part.squares_left(other.weights(*fit))[gaps == gap]
    # In units of the error of hold, averaged over horizons up to an octave away.
    held = np.trace(whole.future, axis1=1, axis2=2) + whole.axes * RESOLUTION**2
    near = (np.abs(np.log2(steps[:, None] / steps)) <= _OCTAVES).astype(float)
    averaged = errors / held @ (near / near.sum(axis=0))
    return [candidates[i] for i in _least_moved_of_the_best(averaged, moved)]


def _least_moved_of_the_best(errors: Array, moved: Array) -> list[int]:
    """Return for each horizon the candidate that moves least (candidates, H) among those as good as the best."""
    best = errors.mean(axis=1).argmin(axis=0)
    worse = errors - np.take_along_axis(errors, best[None, None], axis=0)
    standard_errors = worse.std(axis=1, ddof=1) / np.sqrt(errors.shape[1])
    as_good = worse.mean(axis=1) <= _STANDARD_ERRORS * standard_errors
    return [int(i) for i in np.where(as_good, moved, np.inf).argmin(axis=0)]


STEP_HZ = 30
_LAGS = (*range(1, 16), 20, 25, 30, 40, 60, 90)
_HORIZONS = (*range(1, 16), 18, 21, 25, 30, 36, 45, 60, 75, 90, 120, 150)
_PENALTIES = (0.0001, 0.001, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 1000.0)
"""The last one is practically hold: moves of a thousandth."""
_MAX_LAGS = (5, 10, 15, 30, 90)
_N_PARTS = 8


def fit_direct(outputs: Sequence[Array], rate_hz: int, moved: Moved = differences) -> DirectModel:
    """Return the model of one arm's or several arms' signals (N, v); raises `DataError` for too few rows.

    The signals are positions in m, or others whose displacements ``moved`` returns. A step is a 30th of a second, or
    a sample where that is longer. With few rows the longest lags and horizons are omitted: no lag exceeds an eighth,
    no horizon a quarter of the longest trial. Oracles in test_direct_ls: numpy's least squares on rows built one by
    one, the predictor of a known process, and hold where the short head of a movement carries no information.
    """
    stride = max(1, round(rate_hz / STEP_HZ))
    longest = max((len(y) for y in outputs), default=0) // stride
    lags = np.array([lag for lag in _LAGS if lag <= longest // 8])
    horizons = np.array(steps_of(longest // 4))
    if len(lags) == 0:
        rule = f"direct_ls needs {8 * stride} rows in one trial"
        raise DataError(Fault("identification", "training rows", rule, longest * stride))
    parts = moments(outputs, lags, horizons, stride, _N_PARTS, moved)
    whole = pooled(parts)
    walk = random_walk(whole.past, lags)
    used = sorted({int(np.searchsorted(lags, back, side="right")) for back in _MAX_LAGS})
    candidates = [Candidate(n_lags, penalty) for n_lags in used for penalty in _PENALTIES]
    chosen = most_cautious(parts, walk, candidates, horizons * stride)
    model = DirectModel(
        stride=stride,
        lags=lags,
        horizons=horizons,
        past=whole.past,
        cross=whole.cross,
        future=whole.future,
        n_lags=np.array([each.n_lags for each in chosen]),
        penalty=np.array([each.penalty for each in chosen]),
        covariance_scale=np.ones(len(horizons)),
    )
    return replace(model, covariance_scale=_covariance_scale(model, whole, walk, outputs, moved))


def steps_of(most: int) -> list[int]:
    """Return the horizons up to ``most`` steps."""
    return [h for h in _HORIZONS if h <= most]


def _covariance_scale(
    model: DirectModel, whole: Moments, walk: Array, outputs: Sequence[Array], moved: Moved
) -> Array:
    """Return the factors (H,) for the residuals' moments on the rows that the regressions were fitted to.

    `coverage_factor` accounts for heavy tails, `prediction_factor` for a fit to few windows.
    """
    fits = [
        regression(model, walk, penalty, j, slice(model.axes * n_lags))
        for j, (n_lags, penalty) in enumerate(zip(model.n_lags.tolist(), model.penalty.tolist(), strict=True))
    ]
    errors: list[list[Array]] = [[] for _ in fits]
    for y in outputs:
        pasts, futures = windows([y], model.lags, model.horizons, model.stride, moved)
        for j, (weights, _) in enumerate(fits):
            errors[j].append(futures[:, j] - pasts[:, : len(weights)] @ weights)
    scales = []
    for j, (weights, left) in enumerate(fits):
        steps, kept = int(model.horizons[j]) * model.stride, slice(len(weights))
        past = whole.past[kept, kept]
        n_free = float(np.trace(np.linalg.solve(past + model.penalty[j] * walk[kept, kept], past)))
        by_chance = prediction_factor(independent_windows(whole.n_rows, steps), n_free, axes=model.axes)
        scales.append(by_chance * coverage_factor(np.concatenate(errors[j]), left, steps))
    return np.array(scales)
