"""Training of the Gaussian process on a factorised kernel: low-rank plus sparse instead of inducing points.

Boabang et al. 2021, "A machine learning framework for handling delayed/lost packets in Tactile Internet remote
robotic surgery" (IEEE Trans. Network and Service Management 18:4829), scale the process to more rows by a randomised
low-rank plus sparse factorisation of the kernel matrix. The coefficients solve ``(K^ + ratio I) c = y`` by conjugate
gradients, which need products with the two parts only. What is late or lost in training rows is interpolated, as in a
run.
"""

from typing import Final, Literal, NamedTuple

import numpy as np
import scipy
from scipy.special import ndtri

from tis.common.streams import Stream
from tis.patient_side.learned.gaussian_process import AGES, features_of, kernel
from tis.patient_side.learned_model import Singles
from tis.patient_side.learning.examples import Examples
from tis.patient_side.learning.process_scales import Noise, chosen_rows, noise_on
from tis.patient_side.model_fields import Floats

# A symmetric matrix as a randomised low-rank part plus a sparse one, for kernel matrices too large to invert.
#
# GoDec (Zhou and Tao 2011, "GoDec: randomized low-rank and sparse matrix decomposition in noisy case"), as the kernel
# versions of SRLSMF use it (Boabang et al. 2021): the two parts are found in turn. The low-rank part comes from a
# random projection (Halko, Martinsson and Tropp 2011). The sparse part keeps the largest entries of what that leaves
# (SRLSMF), or shrinks all of them (l1-SRLSMF).

Kind = Literal["largest", "shrunk"]

_N_ROUNDS: Final = 10
_OVERSAMPLED: Final = 10


class LowRankPlusSparse(NamedTuple):
    """``vectors diag(values) vectors' + sparse``, with vectors (N, r), values (r,) and a symmetric sparse (N, N)."""

    vectors: Floats
    values: Floats
    sparse: scipy.sparse.csr_array

    def times(self, x: Floats) -> Floats:
        """Return the product with x (N, ...)."""
        scaled = self.values.reshape(-1, *[1] * (x.ndim - 1)) * (self.vectors.T @ x)
        return np.asarray(self.vectors @ scaled + self.sparse @ x)


def decompose(matrix: Floats, rank: int, share: float, kind: Kind, stream: Stream) -> LowRankPlusSparse:
    """Return the parts of a symmetric matrix (N, N); about ``share`` of all entries are in the sparse one.

    Oracles in test_low_rank_plus_sparse: a matrix made of both, numpy's eigenvalues, soft thresholds by hand.
    """
    n = len(matrix)
    rank = min(rank, n)
    width = min(n, rank + _OVERSAMPLED)
    test = ndtri(stream.uniforms(0, n * width)).reshape(n, width)
    sparse = np.zeros_like(matrix)
    vectors, values = np.zeros((n, rank)), np.zeros(rank)
    for _ in range(_N_ROUNDS):
        rest = matrix - sparse
        basis, _ = np.linalg.qr(rest @ (rest @ test))
        small, turned = np.linalg.eigh(basis.T @ rest @ basis)
        largest = np.argsort(-np.abs(small))[:rank]
        values, vectors = small[largest], basis @ turned[:, largest]
        left = matrix - (vectors * values) @ vectors.T
        bound = float(np.quantile(np.abs(left), 1.0 - share))
        if kind == "largest":
            sparse = np.where(np.abs(left) > bound, left, 0.0)
        else:
            sparse = np.sign(left) * np.maximum(np.abs(left) - bound, 0.0)
    return LowRankPlusSparse(vectors, values, scipy.sparse.csr_array(sparse))


N_POINTS: Final = 2000
RANK: Final = 100
SPARSE_SHARE: Final = 0.02

_TOLERANCE: Final = 1e-4
_MAX_ROUNDS: Final = 300


def fit_srlsmf(
    examples: Examples, judged: Examples, scale: Floats, seed: int, kind: Kind, noise: Noise | None = None
) -> tuple[dict[str, Singles], Noise]:
    """Return the weights of a process with the inverse length scales ``scale`` (F,), and its noise.

    The kernel is factorised in the way ``kind``. The ``noise`` is chosen on the examples ``judged`` unless it is
    given, as it must be where ``examples`` hold them. Oracles in test_fit_srlsmf: numpy's solution with the same
    matrix, and the exact process where the rank is full.
    """
    features = features_of(examples.window)
    rows = chosen_rows(len(features), N_POINTS, Stream.named(seed, "learning/srlsmf/points"))
    points, left = features[rows] * scale, examples.left[rows].astype(float)
    found = decompose(
        kernel(points, points), RANK, SPARSE_SHARE, kind, Stream.named(seed, "learning/srlsmf/projection")
    )
    solved: dict[float, Floats] = {}

    def mean_of(ratio: Floats) -> Floats:
        for each in set(ratio.tolist()):
            if each not in solved:
                solved[each] = coefficients(found, each, left)
        return np.array([solved[each][a] for a, each in enumerate(ratio.tolist())])

    if noise is None:
        noise = noise_on(kernel(features_of(judged.window) * scale, points), mean_of, judged)
    weights = {"points": points, "scale": scale, "mean": mean_of(noise.ratio), "noise": noise.squares}
    return {name: each.astype(np.float32) for name, each in weights.items()}, noise


def coefficients(matrix: LowRankPlusSparse, ratio: float, left: Floats) -> Floats:
    """Return c (A, N, 3) that solves ``(K^ + ratio I) c = left`` for targets (N, A, 3); 0 where no solution is found.

    A sparse part can make the sum indefinite, which a small ratio does not mend: then there is none.
    """
    n = len(left)
    targets = left.reshape(n, -1)
    operator = scipy.sparse.linalg.LinearOperator(
        (n, n), matvec=lambda x: matrix.times(x) + ratio * x, dtype=np.float64
    )
    columns = np.zeros_like(targets)
    for k in range(targets.shape[1]):
        solution, failed = scipy.sparse.linalg.cg(operator, targets[:, k], rtol=_TOLERANCE, maxiter=_MAX_ROUNDS)
        if failed:
            return np.zeros((len(AGES), n, 3))
        columns[:, k] = solution
    return np.moveaxis(columns.reshape(left.shape), 0, 1)
