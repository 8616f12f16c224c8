"""Length scales of a Gaussian process by scikit-learn, from some of the training rows.

The noise of a Gaussian process, for each age, chosen on examples that it has not learned from.
"""

import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any, Final, NamedTuple

import numpy as np
import scipy

from tis.common.streams import Stream
from tis.patient_side.learned.gaussian_process import AGES, GROUPS
from tis.patient_side.learning.examples import Examples, rotations
from tis.patient_side.model_fields import Floats

RATIOS: Final = np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 1e4, 1e6])
"""Ratios of noise to signal that are tried; the last one is practically the linear forecast."""


class Noise(NamedTuple):
    """Ratios of noise to signal (A,) at all ages, and the mean squares (A,) of the errors with them, in units."""

    ratio: Floats
    squares: Floats


def noise_on(z: Floats, mean_of: Callable[[Floats], Floats], judged: Examples) -> Noise:
    """Return, for each age, the ratio with the smallest error in m on examples that were held out.

    ``z`` (B, M) are their kernel vectors, ``mean_of`` returns the coefficients (A, M, 3) of the mean at ratios (A,).
    Oracle: noise, of which nothing can be learned.
    """
    unit_m = judged.unit_m[:, :, None]
    best, ratio, squares = np.full(len(AGES), np.inf), np.full(len(AGES), RATIOS[-1]), np.zeros(len(AGES))
    for each in RATIOS.tolist():
        errors = judged.left - np.einsum("bm,amc->bac", z, mean_of(np.full(len(AGES), each)))
        in_m2 = np.sum((unit_m * errors) ** 2, axis=(0, 2))
        better = in_m2 < best
        best, ratio = np.where(better, in_m2, best), np.where(better, each, ratio)
        squares = np.where(better, np.mean(errors**2, axis=(0, 2)), squares)
    return Noise(ratio, squares)


_N_ROWS: Final = 400
_MAX_ROUNDS: Final = 30
"""Rounds of the search: later ones gain next to nothing."""
_FITTED_AT: Final = (6.0, 15.0)
"""Ages in steps, 200 and 500 ms, whose rows decide the scales of all."""
_LARGEST: Final = 4.0
"""Bounds the effect of one row, in deviations."""
_FIRST_LENGTH: Final = 5.0
_LENGTHS: Final = (0.5, 1e4)


def turned(examples: Examples, seed: int) -> Examples:
    """Return the examples, each turned at random: the hand has no preferred direction."""
    drawn = Stream.named(seed, "learning/process/turns").uniforms(0, 3 * len(examples)).reshape(-1, 3)
    turns = rotations(drawn)
    window = examples.window._replace(way=examples.window.way @ turns)
    return replace(examples, window=window, moves=examples.moves @ turns, left=examples.left @ turns)


def chosen_rows(n_rows: int, n_wanted: int, stream: Stream) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    """Return at most ``n_wanted`` different rows, drawn at random."""
    return np.sort(np.argsort(stream.uniforms(0, n_rows), kind="stable")[:n_wanted])


def inverse_lengths(features: Floats, left: Floats, seed: int) -> Floats:
    """Return the factors (F,) that make the features (B, F) lengths of a process of ``left`` (B, A, 3).

    They maximise the marginal likelihood of some rows at 200 and 500 ms; axes of one vector share a scale. Oracle: a
    process of known scales, test_process_scales.
    """
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    rows = chosen_rows(len(features), _N_ROWS, Stream.named(seed, "learning/process/scales"))
    variance = features.var(axis=0)
    for group in set(GROUPS.tolist()):
        variance[group == GROUPS] = variance[group == GROUPS].mean()
    deviation = np.sqrt(np.maximum(variance, 1e-18))
    x = features[rows] / deviation
    y = left[rows][:, np.searchsorted(AGES, _FITTED_AT)].reshape(len(rows), -1).astype(float)
    y = np.clip(y / np.maximum(y.std(axis=0), 1e-12), -_LARGEST, _LARGEST)
    lengths = np.full(features.shape[1], _FIRST_LENGTH)
    kernel = ConstantKernel(0.3, (1e-3, 1e2)) * RBF(lengths, _LENGTHS) + WhiteKernel(0.7, (1e-3, 1e2))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ConvergenceWarning)  # a feature without effect has no upper bound of length
        fitted = GaussianProcessRegressor(kernel, alpha=1e-8, optimizer=_search).fit(x, y)
    found = np.asarray(fitted.kernel_.k1.k2.length_scale)
    precision = found**-2.0
    for group in set(GROUPS.tolist()):
        precision[group == GROUPS] = precision[group == GROUPS].mean()
    return np.asarray(np.sqrt(precision) / deviation)


def _search(negative: Callable[[Floats], Any], first: Floats, bounds: Floats) -> tuple[Floats, float]:
    """Minimise the negative likelihood, as scikit-learn asks its optimisers to."""
    found = scipy.optimize.minimize(
        negative, first, jac=True, method="L-BFGS-B", bounds=list(bounds), options={"maxiter": _MAX_ROUNDS}
    )
    return np.asarray(found.x), float(found.fun)
