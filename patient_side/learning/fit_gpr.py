"""Training of the sparse Gaussian process: inducing points, whitening, and the noise of each age by held-out rows.

With the kernel matrix of the points ``K = L L'`` and that of points and rows ``B``, the whitened rows are ``root B``,
``root = U' L^-1``, where ``L^-1 B B' L^-T = U diag(e) U'``. Every ratio of noise to signal then costs a division, so
all are tried (Quinonero-Candela and Rasmussen 2005, equation 20b).
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
import scipy

from common.streams import Stream
from patient_side.learned.gaussian_process import AGES, features_of, kernel
from patient_side.learned_model import Floats, Singles
from patient_side.learning.examples import Examples
from patient_side.learning.process_scales import chosen_rows

N_POINTS: Final = 512
RATIOS: Final = np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1e3, 1e4, 1e6])
"""Ratios of noise to signal that are tried; the last one is practically the linear forecast."""

_JITTER: Final = 1e-6
_ROWS_AT_ONCE: Final = 8192


class Whitened(NamedTuple):
    """``root`` (M, M), the eigenvalues e (M,), and the whitened rows' products with the targets (M, A, 3)."""

    root: Floats
    eigenvalues: Floats
    products: Floats

    def mean(self, ratio: Floats) -> Floats:
        """Return the coefficients (A, M, 3) of the mean, with ratios of noise to signal (A,)."""
        shrunk = self.products / (self.eigenvalues[:, None] + ratio)[:, :, None]
        return np.moveaxis(shrunk, 1, 0)


def fit_gpr(examples: Examples, held: Examples | None, scale: Floats, seed: int) -> dict[str, Singles]:
    """Return the weights of a process with the inverse length scales ``scale`` (F,).

    The noise is that of the examples ``held``, of the training rows' own where there are none.
    Oracles in test_fit_gpr: the closed form with all rows as points, scikit-learn's regressor.
    """
    features, left = features_of(examples.window), examples.left.astype(float)
    rows = chosen_rows(len(features), N_POINTS, Stream.named(seed, "learning/gpr/points"))
    points = features[rows] * scale
    whitened = whiten(points, features * scale, left)
    judged = examples if held is None else held
    z = kernel(features_of(judged.window) * scale, points) @ whitened.root.T
    ratio, squares = best_ratios(z, whitened.mean, judged)
    known = 1.0 - ratio[:, None] / (whitened.eigenvalues + ratio[:, None])
    unknown = np.maximum(1.0 - (z * z) @ known.T, 0.0).mean(axis=0)
    signal = squares / (ratio + unknown)
    weights = {
        "points": points,
        "scale": scale,
        "root": whitened.root,
        "mean": whitened.mean(ratio),
        "left": 1.0 - known,
        "signal": signal,
        "noise": ratio * signal,
    }
    return {name: each.astype(np.float32) for name, each in weights.items()}


def whiten(points: Floats, x: Floats, left: Floats) -> Whitened:
    """Return the whitened form of rows x (B, F), in length scales, with targets (B, A, 3)."""
    n_points = len(points)
    factor = np.linalg.cholesky(kernel(points, points) + _JITTER * np.eye(n_points))
    gram, products = np.zeros((n_points, n_points)), np.zeros((n_points, left[0].size))
    for begin in range(0, len(x), _ROWS_AT_ONCE):
        part = slice(begin, begin + _ROWS_AT_ONCE)
        half = scipy.linalg.solve_triangular(factor, kernel(points, x[part]), lower=True)
        gram += half @ half.T
        products += half @ left[part].reshape(half.shape[1], -1)
    eigenvalues, turn = np.linalg.eigh(gram)
    root = turn.T @ scipy.linalg.solve_triangular(factor, np.eye(n_points), lower=True)
    return Whitened(root, np.maximum(eigenvalues, 0.0), (turn.T @ products).reshape(n_points, *left.shape[1:]))


def best_ratios(z: Floats, mean_of: Callable[[Floats], Floats], judged: Examples) -> tuple[Floats, Floats]:
    """Return, for each age, the ratio with the smallest error in m on examples, and its mean square (A,) in units.

    ``z`` (B, M) are the examples' kernel vectors, ``mean_of`` returns the coefficients (A, M, 3) at ratios (A,).
    """
    unit_m = judged.unit_m[:, :, None]
    best, ratio, squares = np.full(len(AGES), np.inf), np.full(len(AGES), RATIOS[-1]), np.zeros(len(AGES))
    for each in RATIOS.tolist():
        errors = judged.left - np.einsum("bm,amc->bac", z, mean_of(np.full(len(AGES), each)))
        in_m2 = np.sum((unit_m * errors) ** 2, axis=(0, 2))
        better = in_m2 < best
        best, ratio = np.where(better, in_m2, best), np.where(better, each, ratio)
        squares = np.where(better, np.mean(errors**2, axis=(0, 2)), squares)
    return ratio, squares
