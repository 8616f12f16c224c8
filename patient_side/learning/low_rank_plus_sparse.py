"""A symmetric matrix as a randomised low-rank part plus a sparse one, for kernel matrices too large to invert.

GoDec (Zhou and Tao 2011, "GoDec: randomized low-rank and sparse matrix decomposition in noisy case"), as the kernel
versions of SRLSMF use it (Boabang et al. 2021): the two parts are found in turn. The low-rank part comes from a
random projection (Halko, Martinsson and Tropp 2011). The sparse part keeps the largest entries of what that leaves
(SRLSMF), or shrinks all of them (l1-SRLSMF).
"""

from typing import Final, Literal, NamedTuple

import numpy as np
import scipy
from scipy.special import ndtri

from common.streams import Stream
from patient_side.learned_model import Floats

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
