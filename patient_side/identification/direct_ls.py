"""Multi-horizon least squares: where the arm will be, straight from where it has been, one regression a horizon.

A sample's past is the arm's positions some steps ago relative to it, its future those some steps ahead. What the
training rows tell is kept as their second moments, so that the regression can be worked out for whichever past
samples have arrived: of least squares on a subset of the regressors the moments are the subset's. Both arms' rows may
be pooled, as nothing but differences of positions counts.

The regularisation acts as if the past had been a random walk more than it was: the moments get those of a random walk
of independent steps, ``penalty`` times the mean square step. So it has one meaning for every subset, and shrinks what
is concluded from fine detail. How much of it, and how far back the past is looked at, is found on held-back rows,
horizon by horizon.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.errors import DataError, Fault
from patient_side.identification.coverage import coverage_factor
from patient_side.identification.noise import SENSOR_RESOLUTION_M
from patient_side.identification.trials import n_first
from patient_side.identification.validation import HELD_BACK
from patient_side.statespace import Array, DirectModel

_STEP_HZ = 30
_LAGS = (*range(1, 16), 20, 25, 30, 40, 60, 90)
_HORIZONS = (*range(1, 16), 18, 21, 25, 30, 36, 45, 60, 75, 90, 120, 150)
_PENALTIES = (0.0001, 0.001, 0.01, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0)
_LOOKED_BACK = (5, 10, 15, 30, 90)


@dataclass(frozen=True)
class Moments:
    """Second moments of pasts z (3 L,) and futures (H, 3), means over ``n_rows`` rows."""

    past: Array
    cross: Array
    future: Array
    n_rows: int


def fit_direct(outputs: Sequence[Array], rate_hz: int) -> DirectModel:
    """Return the model of one arm's or several arms' positions (N, 3) in m; raises `DataError` for too few rows.

    Steps are of a 30th of a second, or of a sample where that is longer. With few rows the longest lags and horizons
    are left out: no lag is above an eighth, no horizon above a quarter of the longest trial. Oracles in
    test_direct_ls: numpy's least squares on rows built one by one, and the predictor of a known process.
    """
    stride = max(1, round(rate_hz / _STEP_HZ))
    longest = max((len(y) for y in outputs), default=0) // stride
    lags = np.array([lag for lag in _LAGS if lag <= longest // 8])
    horizons = np.array([h for h in _HORIZONS if h <= longest // 4])
    if len(lags) == 0:
        rule = f"direct_ls needs {8 * stride} rows in one trial"
        raise DataError(Fault("identification", "training rows", rule, longest * stride))
    cuts = [n_first(len(y), HELD_BACK) for y in outputs]
    whole = moments(outputs, lags, horizons, stride)
    first = moments([y[:cut] for y, cut in zip(outputs, cuts, strict=True)], lags, horizons, stride)
    # the last rows' pasts may reach back before the cut: a past is an input, not a target
    reach = int(lags[-1]) * stride
    last = [y[max(0, cut - reach) :] for y, cut in zip(outputs, cuts, strict=True)]
    pasts, futures = windows(last, lags, horizons, stride)
    if first.n_rows == 0 or len(pasts) == 0:
        rule = "direct_ls needs more rows in one trial to fit and to validate on"
        raise DataError(Fault("identification", "training rows", rule, longest * stride))

    walk = random_walk(whole.past, lags)
    used = sorted({int(np.searchsorted(lags, back, side="right")) for back in _LOOKED_BACK})
    choices = [(n_lags, penalty) for n_lags in used for penalty in _PENALTIES]
    chosen, scales = [], np.empty(len(horizons))
    for j in range(len(horizons)):
        fits = [regression(first, walk, penalty, j, slice(3 * n_lags)) for n_lags, penalty in choices]
        errors = [futures[:, j] - pasts[:, : len(weights)] @ weights for weights, _ in fits]
        best = int(np.argmin([np.sum(error**2) for error in errors]))
        chosen.append(choices[best])
        scales[j] = coverage_factor(errors[best], fits[best][1], int(horizons[j]) * stride)
    return DirectModel(
        stride=stride,
        lags=lags,
        horizons=horizons,
        past=whole.past,
        cross=whole.cross,
        future=whole.future,
        n_lags=np.array([n_lags for n_lags, _ in chosen]),
        penalty=np.array([penalty for _, penalty in chosen]),
        covariance_scale=scales,
    )


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


def moments(outputs: Sequence[Array], lags: NDArray[np.int64], horizons: NDArray[np.int64], stride: int) -> Moments:
    """Return the second moments of `windows`, trial by trial, so that memory is that of one trial."""
    d, n_horizons, n_rows = 3 * len(lags), len(horizons), 0
    past, cross, future = np.zeros((d, d)), np.zeros((n_horizons, d, 3)), np.zeros((n_horizons, 3, 3))
    for y in outputs:
        z, t = windows([y], lags, horizons, stride)
        past += z.T @ z
        cross += (z.T @ t.reshape(len(t), 3 * n_horizons)).reshape(d, n_horizons, 3).transpose(1, 0, 2)
        future += np.einsum("khi,khj->hij", t, t)
        n_rows += len(z)
    return Moments(past / max(1, n_rows), cross / max(1, n_rows), future / max(1, n_rows), n_rows)


def random_walk(past: Array, lags: NDArray[np.int64]) -> Array:
    """Return the moments (3 L, 3 L) of a random walk with the mean step of ``past`` (3 L, 3 L), alike on all axes."""
    step_m2 = max(float(np.trace(past[:3, :3])) / 3, SENSOR_RESOLUTION_M**2)
    return np.asarray(np.kron(step_m2 * np.minimum.outer(lags, lags), np.eye(3)))


def regression(
    found: Moments | DirectModel, walk: Array, penalty: float, horizon: int, kept: slice | NDArray[np.intp]
) -> tuple[Array, Array]:
    """Return the weights (kept, 3) on some of a past's elements, and what they leave of a future (3, 3), in m^2.

    ``horizon`` is the position of the horizon. What is left is floored at the sensor's resolution.
    """
    past, cross, future = found.past[kept][:, kept], found.cross[horizon][kept], found.future[horizon]
    weights = np.linalg.solve(past + penalty * walk[kept][:, kept], cross)
    explained = weights.T @ cross
    left = future - explained - explained.T + weights.T @ past @ weights
    return weights, (left + left.T) / 2 + SENSOR_RESOLUTION_M**2 * np.eye(len(future))
