"""MOESP as in the paper: ordinary MOESP on one set of block Hankel matrices (its Algorithm 2).

The paper is Lashari, Batayneh, Khokhar and Ahmed, "Enhanced Position Estimation in Tactile Internet-Enabled
Remote Robotic Surgery Using MOESP-Based Kalman Filter". Its signals are min-max normalised, to [0, 1] on each
channel, and not centred: the lower ends of the ranges are the operating point. The constant that the model needs
there appears as a state of its own with an eigenvalue at 1.

With ``Y = O X + Psi U`` for depth d, the factor ``[U; Y] = [R11 0; R21 R22] Q`` separates the part of Y that the
inputs of the same stretch do not explain: the left singular vectors of R22 span O. ``O_k = U1 sqrt(S1)`` gives C as
its first block row and A by its shift invariance. The vectors beyond the order, ``L1 = U2'``, annihilate O, so that
``M1 = L1 R21 R11^-1 = L1 Psi``, linear in D and B.

The listing specifies only "form M and L". The construction consistent with its other lines (B under D in the
solution) is Verhaegen and Dewilde's (1992, Int. J. Control 56:1187): Psi is block Toeplitz, its k-th block column
is ``[0; D; C B; C A B; ...]``, D in block row k, so with L1 split into blocks of p columns

    M = [M1(1); ...; M1(d)],    L = [L1(k), [L1(k+1) ... L1(d)] O_k(first d - k block rows)], k = 1..d.

The state is scaled as in the printed listing: the data are not divided by the root of the number of columns.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tis.patient_side.identification.hankel import block_hankel
from tis.patient_side.identification.subspace import check_excitation
from tis.patient_side.identification.trials import Trial
from tis.patient_side.statespace import Array, StateSpace

_NEGLIGIBLE = 1e-10


@dataclass(frozen=True)
class PaperSubspace:
    """U1 (d p, d p), the singular values (d p,) of R22, ``rank`` of them significant, ``R21 R11^-1`` (d p, d m)."""

    left: Array
    singular_values: Array
    rank: int
    response: Array
    n_inputs: int
    n_outputs: int


def paper_subspace(trials: Sequence[Trial], block_rows: int) -> tuple[PaperSubspace, tuple[str, ...]]:
    """Return the listing's LQ and SVD of trials (N, m), (N, p) and a warning when the inputs excite weakly.

    The paper has one trial; the columns of several stand side by side, and none crosses a border. Raises
    `DataError` when the inputs' Hankel matrix is rank-deficient, as R11 is inverted.
    """
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    past = block_rows * n_inputs
    factor = np.empty((0, block_rows * (n_inputs + n_outputs)))
    for u, y in trials:
        columns = np.vstack([block_hankel(u, block_rows), block_hankel(y, block_rows)])
        factor = np.asarray(np.linalg.qr(np.vstack([factor, columns.T]), mode="r"))
    warnings = check_excitation(factor, past)
    R11, R21, R22 = factor[:past, :past].T, factor[:past, past:].T, factor[past:, past:].T
    left, values, _ = np.linalg.svd(R22)
    rank = int(np.count_nonzero(values > _NEGLIGIBLE * np.linalg.norm(factor[:, past:])))
    response = np.linalg.solve(R11.T, R21.T).T
    return PaperSubspace(left, values, rank, response, n_inputs, n_outputs), warnings


def paper_model(found: PaperSubspace, order: int) -> StateSpace:
    """Return the listing's A, B, C, D for 0 <= ``order`` <= (d - 1) p; A may be unstable.

    Oracles in test_moesp_paper: eigenvalues and Markov parameters of a known system.
    """
    m, p = found.n_inputs, found.n_outputs
    depth = len(found.left) // p
    O_k = found.left[:, :order] * np.sqrt(found.singular_values[:order])
    C = np.ascontiguousarray(O_k[:p])
    A = np.asarray(np.linalg.lstsq(O_k[:-p], O_k[p:])[0]) if order else np.empty((0, 0))

    L1 = found.left[:, order:].T
    M1 = L1 @ found.response
    M = np.vstack([M1[:, k * m : (k + 1) * m] for k in range(depth)])
    L = np.vstack(
        [
            np.hstack([L1[:, k * p : (k + 1) * p], L1[:, (k + 1) * p :] @ O_k[: (depth - 1 - k) * p]])
            for k in range(depth)
        ]
    )
    DB = np.asarray(np.linalg.lstsq(L, M)[0])
    return StateSpace(A, np.ascontiguousarray(DB[p:]), C, np.ascontiguousarray(DB[:p]))
