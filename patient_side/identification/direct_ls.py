"""Multi-horizon least squares: one regression for each horizon, from past to future directly.

The training rows are reduced to their second moments: see `second_moments`. Cross-validation selects for each horizon
the shrinkage towards holding the last position and the number of lags: see `cautious_choice`.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from common.errors import DataError, Fault
from patient_side.direct_model import Array, DirectModel
from patient_side.identification.cautious_choice import Candidate, most_cautious
from patient_side.identification.coverage import coverage_factor, independent_windows, prediction_factor
from patient_side.identification.second_moments import (
    Moments,
    Moved,
    differences,
    moments,
    pooled,
    random_walk,
    regression,
    windows,
)

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
