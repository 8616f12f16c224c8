"""Completion of a movement by direct robust matrix factorisation of its Hankel matrix.

Column c of the Hankel matrix is the stretch of R positions from c on. The columns of a movement are nearly in a space
of few dimensions, those of a sum of K damped sinusoids exactly in one of 2 K. A position that is missing, late or
lost, is missing in up to R columns, and in each the low-rank part fills it from the others; the last columns reach
beyond the newest position, and what fills them is the forecast.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.patient_side.filters.robust_factorisation import largest, left_factor, low_rank_part
from tis.patient_side.movement_models import Factorisation
from tis.patient_side.statespace import Array


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
