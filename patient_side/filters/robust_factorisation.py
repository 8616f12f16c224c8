"""The steps of direct robust matrix factorisation (Xiong, Chen and Schneider, ICDM 2011) with missing entries.

A matrix X with columns x_c (R,) is split into a low-rank part, a sparse part and a rest,

    min ||X - L - S||_F   with   rank(L) <= K   and   ||S||_0 <= e,

by turns: L is the truncated singular value decomposition of X - S, S takes what L leaves most of. Columns may come
with several axes, which share the left factor, and have entries that are missing; a missing entry costs nothing, so
that L fills it. Each column has a level of its own beside the factors, without a penalty: L is the same wherever the
origin of X is.

The functions take one matrix, or a stack of matrices of one shape along leading axes: each is so small that the
calls of numpy would otherwise take longer than the arithmetic.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.statespace import Array

_MIN_SHRINKAGE = 1e-12
"""Ridge in any case, as columns may have fewer known entries than factors."""


class LeftFactor(NamedTuple):
    """Orthonormal factors (..., R, K + 1), the level first, and the ridge of each one's coefficient (..., K + 1)."""

    basis: Array
    shrinkage: Array


def left_factor(moments: Array, rank: int, ridge: float, least_noise: float) -> LeftFactor:
    """Return the level and the first ``rank`` left singular vectors of columns, from their second moments.

    Parameters
    ----------
    moments : Array
        (..., R, R), ``sum_c w_c x_c x_c' / sum_c w_c`` of the columns, in m^2, whatever their levels.
    rank : int
        K, at most R - 1.
    ridge : float
        Shrinkage of the coefficients, in units of the one that probabilistic principal components have: noise, which
        is the mean square of what ``rank`` factors leave, over the factor's mean square (Tipping and Bishop, 1999).
        0: none, plain least squares.
    least_noise : float
        Least noise, in m^2.

    Returns
    -------
    LeftFactor
        The factors of the columns without their levels, largest first.

    Notes
    -----
    The eigenvectors of X X' are the left singular vectors of X. Oracle: numpy's singular value decomposition.
    """
    n_rows = moments.shape[-1]
    about_level = moments - moments.mean(axis=-2, keepdims=True)
    about_level -= about_level.mean(axis=-1, keepdims=True)
    variances, vectors = np.linalg.eigh(about_level)
    kept = np.maximum(variances[..., : -rank - 1 : -1], least_noise)
    # The level is one more eigenvector, with the eigenvalue 0.
    left = variances[..., :-rank].sum(axis=-1, keepdims=True) / max(n_rows - rank - 1, 1)
    basis, shrinkage = np.empty((*kept.shape[:-1], n_rows, rank + 1)), np.zeros((*kept.shape[:-1], rank + 1))
    basis[..., 0], basis[..., 1:] = n_rows**-0.5, vectors[..., : -rank - 1 : -1]
    shrinkage[..., 1:] = ridge * np.maximum(left, least_noise) / kept
    return LeftFactor(basis, shrinkage + _MIN_SHRINKAGE)


def low_rank_part(columns: Array, known: NDArray[np.bool_], factor: LeftFactor) -> Array:
    """Return the low-rank part (..., C, A, R) of columns, fitted to their known entries (..., C, R).

    ``columns`` (..., C, A, R) have A axes; values of unknown entries have no effect. Oracle: numpy's least squares.
    """
    basis, shape, n_factors = factor.basis, columns.shape, factor.basis.shape[-1]
    flat = (columns * known[..., None, :]).reshape(*shape[:-3], -1, shape[-1])
    right = (flat @ basis).reshape(*shape[:-1], n_factors)
    # Of a column without gaps the normal equations are diagonal, as the factors are orthonormal.
    coefficients = right / (1.0 + factor.shrinkage)[..., None, None, :]
    gappy = ~known.all(axis=-1)
    products = (basis[..., :, None] * basis[..., None, :]).reshape(*basis.shape[:-1], -1)
    left = (known @ products).reshape(*known.shape[:-1], n_factors, n_factors)
    left[..., range(n_factors), range(n_factors)] += factor.shrinkage[..., None, :]
    coefficients[gappy] = np.linalg.solve(left[gappy], right[gappy].swapaxes(1, 2)).swapaxes(1, 2)
    return np.asarray((coefficients.reshape(*flat.shape[:-1], -1) @ basis.swapaxes(-1, -2)).reshape(shape))


def largest(sizes: Array, n_largest: int, least: float) -> NDArray[np.bool_]:
    """Return which of ``sizes`` (..., N) are the ``n_largest`` and above ``least``: the sparse part's support."""
    chosen = np.zeros(sizes.shape, dtype=bool)
    if n_largest > 0:
        np.put_along_axis(chosen, np.argsort(sizes, kind="stable")[..., -n_largest:], values=True, axis=-1)
    return np.asarray(chosen & (sizes > least))
