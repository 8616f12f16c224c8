"""Second moments of a signal's past and future, and least squares on them.

A sample's past is the signal some steps ago relative to it, its future that some steps ahead: of an arm's position
the differences, of its orientation the rotation vectors. Least squares on a subset of the regressors needs the
subset's moments only, so one set of moments serves any pattern of arrived samples. Both arms' rows may be pooled, as
only displacements matter.

The regularisation adds the moments of a random walk with independent steps, ``penalty`` times the mean square step.
It thus has the same meaning for every subset, reduces the influence of fine detail, and in the limit leaves only the
last position: hold.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.identification.noise import SENSOR_RESOLUTION_M
from tis.patient_side.movement_models import DirectModel
from tis.patient_side.statespace import Array

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
