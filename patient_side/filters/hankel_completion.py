"""Completion of a movement by direct robust matrix factorisation of its Hankel matrix.

Column c of the Hankel matrix is the stretch of R positions from c on. The columns of a movement are nearly in a space
of few dimensions, those of a sum of K damped sinusoids exactly in one of 2 K. A position that is missing, late or
lost, is missing in up to R columns, and in each the low-rank part fills it from the others; the last columns reach
beyond the newest position, and what fills them is the forecast.
"""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from patient_side.completion_model import Factorisation
from patient_side.filters.robust_factorisation import largest, left_factor, low_rank_part
from patient_side.statespace import Array


class Completion(NamedTuple):
    """The last column (R, A) of the low-rank part, the movement (W, A) with S taken out and what is missing filled.

    ``outliers`` (W,) are the positions that S holds, ``left_m`` (W,) is what L leaves of each known position.
    """

    newest: Array
    filled: Array
    outliers: NDArray[np.bool_]
    left_m: Array
    n_turns: int


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
    n_rows, n_axes = len(prior), path.shape[1]
    n_columns = len(path) - n_rows + 1
    filled = _held(path, known)
    clean, moved, turn = known, np.inf, 0
    known_columns = sliding_window_view(clean, n_rows).astype(float)
    while turn < numbers.max_turns and moved > numbers.tolerance_m:
        turn += 1
        # L: first its left factor, from the whole matrix, then its coefficients.
        columns = sliding_window_view(filled, n_rows, axis=0)
        flat = columns.reshape(-1, n_rows)
        moments = (prior_columns * prior + flat.T @ flat) / (prior_columns + n_columns * n_axes)
        factor = left_factor(moments, numbers.rank, numbers.ridge, numbers.least_noise_m2)
        low_rank = low_rank_part(columns, known_columns, factor)
        means = _antidiagonal_means(low_rank)
        # S: what of the known positions L explains least.
        left_m = np.where(known, np.linalg.norm(path - means, axis=1), 0.0)
        clean = known & ~largest(left_m, numbers.n_outliers, numbers.least_outlier_m)
        known_columns = sliding_window_view(clean, n_rows).astype(float)
        before, filled = filled, np.where(clean[:, None], path, means)
        moved = float(np.abs(filled - before).max(initial=0.0))
    return Completion(np.asarray(low_rank[-1].T), filled, known & ~clean, left_m, turn)


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
    """Return the movement (W, A) that is nearest to a matrix of columns (C, A, R). Oracle: a loop over entries."""
    n_columns, n_axes, n_rows = columns.shape
    length = n_columns + n_rows - 1
    # Rows of length W + 1, read as rows of length W, are each shifted by one against the row before.
    skewed = np.zeros((n_axes, n_columns, length + 1))
    skewed[:, :, :n_rows] = columns.transpose(1, 0, 2)
    sums = skewed.reshape(n_axes, -1)[:, : n_columns * length].reshape(n_axes, n_columns, length).sum(axis=1)
    places = np.arange(length)
    counts = np.minimum(np.minimum(places + 1, length - places), min(n_columns, n_rows))
    return np.asarray((sums / counts).T)
