"""Second moments of an arm's past and future positions, and least squares on them.

A sample's past is the arm's positions some steps ago relative to it, its future those some steps ahead. Least squares
on a subset of the regressors needs the subset's moments only, so one set of moments serves any pattern of arrived
samples. Both arms' rows may be pooled, as only differences of positions matter.

The regularisation adds the moments of a random walk with independent steps, ``penalty`` times the mean square step.
It thus has the same meaning for every subset, reduces the influence of fine detail, and in the limit leaves only the
last position: hold.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from patient_side.identification.noise import SENSOR_RESOLUTION_M
from patient_side.statespace import Array, DirectModel


@dataclass(frozen=True)
class Moments:
    """Second moments of pasts z (3 L,) and futures (H, 3): means over ``n_rows`` rows."""

    past: Array
    cross: Array
    future: Array
    n_rows: int

    def weights(self, walk: Array, penalty: float, n_past: int) -> Array:
        """Return the weights (n_past, 3 H) on a past's first elements, for all horizons at once."""
        cross = self.cross[:, :n_past].transpose(1, 0, 2).reshape(n_past, -1)
        return np.asarray(np.linalg.solve(self.past[:n_past, :n_past] + penalty * walk[:n_past, :n_past], cross))

    def squares_left(self, weights: Array) -> Array:
        """Return the residual sum of squares (H,), in m^2 per row, of these futures with weights from any rows."""
        n_past, n_horizons = len(weights), len(self.future)
        by_horizon = weights.reshape(n_past, n_horizons, 3)
        known = np.einsum("dhi,hdi->h", by_horizon, self.cross[:, :n_past])
        return np.asarray(np.trace(self.future, axis1=1, axis2=2) - 2 * known + self.squares_moved(weights))

    def squares_moved(self, weights: Array) -> Array:
        """Return the sum of squares (H,), in m^2 per row, of the moves forecast with these weights."""
        n_past, n_horizons = len(weights), len(self.future)
        products = weights * (self.past[:n_past, :n_past] @ weights)
        return np.asarray(products.reshape(n_past, n_horizons, 3).sum(axis=(0, 2)))


def pooled(parts: Sequence[Moments]) -> Moments:
    """Return the moments of all rows of the parts; at least one part must have rows."""
    counts = np.array([part.n_rows for part in parts])

    def mean(each: list[Array]) -> Array:
        return np.asarray(np.tensordot(counts / counts.sum(), np.stack(each), 1))

    past, cross = mean([part.past for part in parts]), mean([part.cross for part in parts])
    return Moments(past, cross, mean([part.future for part in parts]), int(counts.sum()))


def windows(
    outputs: Sequence[Array], lags: NDArray[np.int64], horizons: NDArray[np.int64], stride: int
) -> tuple[Array, Array]:
    """Return pasts (rows, 3 L) and futures (rows, H, 3), relative to their sample, of all rows that have both."""
    back, ahead = int(lags[-1]) * stride, int(horizons[-1]) * stride
    pasts, futures = [np.empty((0, 3 * len(lags)))], [np.empty((0, len(horizons), 3))]
    for y in outputs:
        now = np.arange(back, len(y) - ahead)
        if len(now):
            pasts.append((y[now[:, None] - lags * stride] - y[now, None]).reshape(len(now), -1))
            futures.append(y[now[:, None] + horizons * stride] - y[now, None])
    return np.concatenate(pasts), np.concatenate(futures)


def moments(
    outputs: Sequence[Array], lags: NDArray[np.int64], horizons: NDArray[np.int64], stride: int, n_parts: int
) -> list[Moments]:
    """Return the second moments of `windows`, in ``n_parts`` parts of equally many rows, one after another.

    They are summed trial by trial, so that memory holds one trial at a time.
    """
    d, n_horizons = 3 * len(lags), len(horizons)
    first_rows = np.cumsum([0] + [max(0, len(y) - int(lags[-1] + horizons[-1]) * stride) for y in outputs])
    borders = np.linspace(0, first_rows[-1], n_parts + 1).astype(int)
    past, cross = np.zeros((n_parts, d, d)), np.zeros((n_parts, n_horizons, d, 3))
    future = np.zeros((n_parts, n_horizons, 3, 3))
    for y, first in zip(outputs, first_rows[:-1], strict=True):
        pasts, futures = windows([y], lags, horizons, stride)
        for part in range(n_parts):
            begin, end = np.clip(borders[part : part + 2] - first, 0, len(pasts))
            z, t = pasts[begin:end], futures[begin:end]
            if len(z):
                past[part] += z.T @ z
                cross[part] += (z.T @ t.reshape(len(t), -1)).reshape(d, n_horizons, 3).transpose(1, 0, 2)
                future[part] += np.einsum("khi,khj->hij", t, t)
    sizes = np.diff(borders)
    sums = zip(past, cross, future, sizes, strict=True)
    return [Moments(p / max(1, n), c / max(1, n), f / max(1, n), int(n)) for p, c, f, n in sums]


def random_walk(past: Array, lags: NDArray[np.int64]) -> Array:
    """Return the moments (3 L, 3 L) of a random walk with the mean step of ``past`` (3 L, 3 L) on every axis."""
    step_m2 = max(float(np.trace(past[:3, :3])) / 3, SENSOR_RESOLUTION_M**2)
    return np.asarray(np.kron(step_m2 * np.minimum.outer(lags, lags), np.eye(3)))


def regression(
    found: Moments | DirectModel, walk: Array, penalty: float, horizon: int, kept: slice | NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return the weights (kept, 3) on some of a past's elements, and the residual moment (3, 3) in m^2.

    ``horizon`` is the position of the horizon. The moment includes the sensor's resolution as a floor.
    """
    past, cross, future = found.past[kept][:, kept], found.cross[horizon][kept], found.future[horizon]
    weights = np.linalg.solve(past + penalty * walk[kept][:, kept], cross)
    explained = weights.T @ cross
    left = future - explained - explained.T + weights.T @ past @ weights
    return weights, (left + left.T) / 2 + SENSOR_RESOLUTION_M**2 * np.eye(len(future))
