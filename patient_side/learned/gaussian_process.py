"""Gaussian processes of what the linear forecast leaves (Rasmussen and Williams 2006), for several ages at once.

All ages and axes share the kernel ``k(x, x') = exp(-|x - x'|^2 / 2)`` of scaled features x; each age has its own
ratio of noise to signal. Between two ages means and deviations are interpolated.

- *Sparse* (`gpr`): M inducing points Z (Quinonero-Candela and Rasmussen 2005, deterministic training conditional).
  With the whitened kernel vector ``z = root k(Z, x)`` the mean at age a is ``z . mean[a]``, and the variance
  ``signal[a] (1 - sum z^2 (1 - left[a]))``, plus noise; ``left[a]`` (M,) is the share of each direction's prior
  variance that the rows leave.
- *Factorised* (`srlsmf`): all N training rows are points, ``root`` is the identity (and not stored), and the
  deviation is that of the held-out errors.
"""

from typing import Final

import numpy as np

from tis.patient_side.learned.inputs import LAGS, N_FINE, Scaled
from tis.patient_side.learned_model import Weights
from tis.patient_side.model_fields import Floats

AGES: Final = np.array([1.0, 2.0, 3.0, 6.0, 10.0, 15.0, 30.0, 60.0, 150.0])
"""Ages of the outputs, in steps."""

N_INCREMENTS: Final = 8
_WAYS_BACK: Final = (4, 8, 15, 30, 60, 150, 300)
_AT: Final = np.searchsorted(LAGS, _WAYS_BACK)
GROUPS: Final = np.array(
    [*np.repeat(np.arange(N_INCREMENTS), 3), *np.repeat(N_INCREMENTS + np.arange(len(_WAYS_BACK)), 3), -3, -2, -1]
)
"""The group of each feature: axes of one vector share a length scale."""
N_FEATURES: Final = len(GROUPS)


def features_of(window: Scaled) -> Floats:
    """Return the features (B, 48) of windows: increments, ways, activity, gripper, the share that has arrived.

    All are bounded, or grow like a logarithm.
    """
    way, gripper, present, pace = (each.astype(float) for each in window)
    increments = np.arcsinh(way[:, :N_INCREMENTS] - way[:, 1 : N_INCREMENTS + 1])
    ways = np.arcsinh(way[:, _AT] / np.sqrt(_WAYS_BACK)[:, None])
    opening, arrived = np.tanh(-gripper[:, N_FINE]), present[:, :N_INCREMENTS].mean(axis=1)
    n = len(way)
    return np.hstack([increments.reshape(n, -1), ways.reshape(n, -1), np.column_stack([pace, opening, arrived])])


def kernel(x: Floats, points: Floats) -> Floats:
    """Return ``exp(-|x - z|^2 / 2)`` (B, M) for scaled features (B, F) and points (M, F)."""
    squares = np.sum(x * x, axis=1)[:, None] + np.sum(points * points, axis=1) - 2.0 * (x @ points.T)
    return np.asarray(np.exp(-0.5 * np.maximum(squares, 0.0)))


def outputs(weights: Weights, features: Floats) -> tuple[Floats, Floats]:
    """Return means (B, A, 3) and deviations (B, A) at all `AGES`, of features (B, 48).

    Oracles: the closed form of a full process with all rows as points, scikit-learn's.
    """
    z = kernel(features * weights["scale"], weights["points"].astype(float))
    if "root" in weights:
        z = z @ weights["root"].T
    mean = np.einsum("bm,amc->bac", z, weights["mean"])
    variance = np.broadcast_to(weights["noise"], (len(z), len(AGES)))
    if "left" in weights:
        known = (z * z) @ (1.0 - weights["left"]).T
        variance = variance + weights["signal"] * np.maximum(1.0 - known, 0.0)
    return mean, np.sqrt(variance)


def at_ages(mean: Floats, deviation: Floats, ages: Floats) -> tuple[Floats, Floats]:
    """Return means (B, K, 3) and deviations (B, K) at ages (B, K), in steps; constant beyond the first and last."""
    at = np.interp(np.log(ages), np.log(AGES), np.arange(len(AGES)))
    below = np.minimum(at.astype(int), len(AGES) - 2)
    share = at - below
    row = np.arange(len(mean))[:, None]
    means = (1.0 - share)[:, :, None] * mean[row, below] + share[:, :, None] * mean[row, below + 1]
    return means, (1.0 - share) * deviation[row, below] + share * deviation[row, below + 1]


def shapes_of(weights: Weights) -> dict[str, tuple[int, ...]]:
    """Return the shapes that the weights must have, by the number of their points."""
    n_points, n_ages = len(weights["points"]), len(AGES)
    found: dict[str, tuple[int, ...]] = {
        "points": (n_points, N_FEATURES),
        "scale": (N_FEATURES,),
        "mean": (n_ages, n_points, 3),
        "noise": (n_ages,),
    }
    if "root" in weights:
        found |= {"root": (n_points, n_points), "left": (n_ages, n_points), "signal": (n_ages,)}
    return found
