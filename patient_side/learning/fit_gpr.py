"""Training of the sparse Gaussian process: inducing points, whitening, and the noise of each age by held-out rows.

With the kernel matrix of the points ``K = L L'`` and that of points and rows ``B``, the whitened rows are ``root B``,
``root = U' L^-1``, where ``L^-1 B B' L^-T = U diag(e) U'``. Every ratio of noise to signal then costs a division, so
all are tried by `process_noise` (Quinonero-Candela and Rasmussen 2005, equation 20b).
"""

from typing import Final, NamedTuple

import numpy as np
import scipy

from tis.common.streams import Stream
from tis.patient_side.learned.gaussian_process import features_of, kernel
from tis.patient_side.learned_model import Singles
from tis.patient_side.learning.examples import Examples
from tis.patient_side.learning.process_scales import Noise, chosen_rows, noise_on
from tis.patient_side.model_fields import Floats

N_POINTS: Final = 512

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


def fit_gpr(
    examples: Examples, judged: Examples, scale: Floats, seed: int, noise: Noise | None = None
) -> tuple[dict[str, Singles], Noise]:
    """Return the weights of a process with the inverse length scales ``scale`` (F,), and its noise.

    The ``noise`` is chosen on the examples ``judged`` unless it is given, as it must be where ``examples`` hold them.
    Oracles in test_fit_gpr: the closed form with all rows as points, scikit-learn's regressor.
    """
    features, left = features_of(examples.window), examples.left.astype(float)
    rows = chosen_rows(len(features), N_POINTS, Stream.named(seed, "learning/gpr/points"))
    points = features[rows] * scale
    whitened = whiten(points, features * scale, left)
    z = kernel(features_of(judged.window) * scale, points) @ whitened.root.T
    noise = noise_on(z, whitened.mean, judged) if noise is None else noise
    ratio = noise.ratio
    known = 1.0 - ratio[:, None] / (whitened.eigenvalues + ratio[:, None])
    unknown = np.maximum(1.0 - (z * z) @ known.T, 0.0).mean(axis=0)
    signal = noise.squares / (ratio + unknown)
    weights = {
        "points": points,
        "scale": scale,
        "root": whitened.root,
        "mean": whitened.mean(ratio),
        "left": 1.0 - known,
        "signal": signal,
        "noise": ratio * signal,
    }
    return {name: each.astype(np.float32) for name, each in weights.items()}, noise


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
