"""Completion of a movement by direct robust matrix factorisation of its Hankel matrix.

Column c of the Hankel matrix is the stretch of R positions from c on. The columns of a movement are nearly in a space
of few dimensions, those of a sum of K damped sinusoids exactly in one of 2 K. A position that is missing, late or
lost, is missing in up to R columns, and in each the low-rank part fills it from the others; the last columns reach
beyond the newest position, and what fills them is the forecast.

The steps of direct robust matrix factorisation (Xiong, Chen and Schneider, ICDM 2011) with missing entries.

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

from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import Factorisation

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


class Completion(NamedTuple):
    """The last column (..., R, A) of the low-rank part, and the movement (..., W, A) without S and with the fill.

    ``outliers`` (..., W) are the positions that S holds, ``left_m`` (..., W) is what L leaves of each known position,
    ``n_turns`` (...) how many turns were taken.
    """

    newest: Array
    filled: Array
    outliers: NDArray[np.bool_]
    left_m: Array
    n_turns: NDArray[np.int64]


def complete(
    path: Array, known: NDArray[np.bool_], prior: Array, prior_columns: float, numbers: Factorisation
) -> Completion:
    """Return a movement's completion, from its positions (W, A) in m and which of them are known (W,).

    Parameters
    ----------
    path : Array
        Positions, oldest first, about any origin near them. Unknown ones have no effect.
    known : NDArray[np.bool_]
        Which positions have arrived, at least one.
    prior : Array
        Second moments (R, R) of columns of other movements, in m^2 per axis; R is the number of Hankel rows.
    prior_columns : float
        How many columns these moments stand for, beside the C = W - R + 1 times A of the path's; 0: none.
    numbers : Factorisation
        Rank, shrinkage and outliers.

    Returns
    -------
    Completion
        The state after the last turn.

    Notes
    -----
    A turn is: the left factor from the filled matrix less S, the coefficients by least squares on known entries, the
    fill by the means of the antidiagonals, S. Oracles in test_hankel_completion: a sum of damped sinusoids.
    """
    return Completion(
        *(each[0] for each in complete_all(path[None], known[None], prior[None], prior_columns, numbers))
    )


def complete_all(
    paths: Array, known: NDArray[np.bool_], priors: Array, prior_columns: float, numbers: Factorisation
) -> Completion:
    """Return the completions of M movements of one length together, as `complete` those of each.

    The arrays are those of `complete` in stacks: (M, W, A), (M, W) and (M, R, R). Oracle: `complete` itself.
    """
    n_rows, n_axes = priors.shape[-1], paths.shape[-1]
    n_columns = paths.shape[1] - n_rows + 1
    places = np.arange(n_columns)[:, None] + np.arange(n_rows)
    done = Completion(
        np.empty((len(paths), n_rows, n_axes)),
        np.array([_held(path, its) for path, its in zip(paths, known, strict=True)]),
        np.zeros(known.shape, dtype=bool),
        np.zeros(known.shape),
        np.zeros(len(paths), dtype=np.int64),
    )
    moving = np.arange(len(paths))
    for _ in range(numbers.max_turns):
        path, arrived, filled = paths[moving], known[moving], done.filled[moving]
        # L: first its left factor, from the whole matrix, then its coefficients.
        columns = np.ascontiguousarray(filled.swapaxes(1, 2)[:, :, places].swapaxes(1, 2))
        flat = columns.reshape(len(moving), -1, n_rows)
        moments = prior_columns * priors[moving] + flat.swapaxes(1, 2) @ flat
        factor = left_factor(
            moments / (prior_columns + n_columns * n_axes), numbers.rank, numbers.ridge, numbers.least_noise_m2
        )
        clean = arrived & ~done.outliers[moving]
        low_rank = low_rank_part(columns, clean[:, places], factor)
        means = _antidiagonal_means(low_rank)
        # S: what of the known positions L explains least.
        left_m = np.where(arrived, np.linalg.norm(path - means, axis=-1), 0.0)
        struck = arrived & largest(left_m, numbers.n_outliers, numbers.least_outlier_m)
        after = np.where((arrived & ~struck)[..., None], path, means)
        done.newest[moving], done.filled[moving] = low_rank[:, -1].swapaxes(1, 2), after
        done.outliers[moving], done.left_m[moving] = struck, left_m
        done.n_turns[moving] += 1
        moving = moving[np.abs(after - filled).max(axis=(1, 2)) > numbers.tolerance_m]
        if not len(moving):
            break
    return done


def column_moments(moves_m2: Array) -> Array:
    """Return the second moments (R, R) of columns about their levels, from mean square moves over 0 .. R - 1 steps.

    Of steady movement, the product of two positions about a column's mean depends on mean square moves alone:
    ``-J D J / 2``, where D_ij is that over |i - j| steps and J takes the mean off
    (classical scaling, Torgerson 1952). Oracle: the columns themselves.
    """
    places = np.arange(len(moves_m2))
    moments = -moves_m2[np.abs(places[:, None] - places)] / 2
    moments -= moments.mean(axis=0)
    return np.asarray(moments - moments.mean(axis=1)[:, None])


def _held(path: Array, known: NDArray[np.bool_]) -> Array:
    """Return the positions with each unknown one replaced by the known one before it, else by the first."""
    places = np.flatnonzero(known)
    before = np.maximum(np.searchsorted(places, np.arange(len(path)), side="right") - 1, 0)
    return path[places[before]]


def _antidiagonal_means(columns: Array) -> Array:
    """Return the movements (M, W, A) nearest to matrices of columns (M, C, A, R). Oracle: a loop over entries."""
    n_movements, n_columns, n_axes, n_rows = columns.shape
    length = n_columns + n_rows - 1
    # Rows of length W + 1, read as rows of length W, are each shifted by one against the row before.
    skewed = np.zeros((n_movements, n_axes, n_columns, length + 1))
    skewed[..., :n_rows] = columns.swapaxes(1, 2)
    read = skewed.reshape(n_movements, n_axes, -1)[..., : n_columns * length]
    sums = read.reshape(n_movements, n_axes, n_columns, length).sum(axis=2)
    places = np.arange(length)
    counts = np.minimum(np.minimum(places + 1, length - places), min(n_columns, n_rows))
    return np.asarray((sums / counts).swapaxes(1, 2))
