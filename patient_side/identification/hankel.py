"""Block Hankel matrices and their triangular factors, in stretches: more columns than memory holds.

Only the triangle L of ``data = L Q`` is needed, and Q's columns are samples. Columns are therefore processed in
stretches that fit the cache, and each stretch is reduced into the existing triangle (LAPACK's tpqrt: the QR
factorisation of a triangle above a rectangle, which skips the triangle's zeros). Normal equations, in place of these
Householder reflections, would square the condition number, and recorded movements excite fast directions a thousandth
as much as slow ones.
"""

from collections.abc import Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg.lapack import dtpqrt

from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array


def block_hankel(signal: Array, block_rows: int) -> Array:
    """Return the block Hankel matrix of ``signal`` (N, d), shape (block_rows * d, N - block_rows + 1).

    Block row i of column j is ``signal[i + j]`` (Verhaegen and Verdult, "Filtering and System
    Identification", section 9.2). Oracle: element-wise construction, test_hankel.
    """
    matrix = np.empty((block_rows * signal.shape[1], max(0, len(signal) - block_rows + 1)))
    fill_hankel(matrix, signal)
    return matrix


def fill_hankel(matrix: Array, signal: Array) -> None:
    """Write the first columns of the block Hankel matrix of ``signal`` (N, d) into ``matrix`` (s d, columns)."""
    n_columns, n_channels = matrix.shape[1], signal.shape[1]
    if matrix.size == 0:
        return
    block_rows = len(matrix) // n_channels
    # Channel by channel in memory, so that whole rows are copied.
    channels = np.ascontiguousarray(signal[: n_columns + block_rows - 1].T)
    windows = sliding_window_view(channels, n_columns, axis=1)
    matrix.reshape(block_rows, n_channels, n_columns)[:] = windows.transpose(1, 0, 2)


COLUMNS_AT_ONCE = 512
"""Columns of one stretch: 120 Hankel rows of them are half a megabyte, which stays in the cache."""

_PANEL = 12


def empty_factor(n_rows: int) -> Array:
    """Return the factor of no columns (n_rows, n_rows)."""
    return np.zeros((n_rows, n_rows), order="F")


def accumulate(factor: Array, columns: Array) -> Array:
    """Return the upper triangular R (d, d) with ``R' R = factor' factor + columns columns'``.

    ``columns`` (d, n), in C order, is overwritten as work space. Rows of R may have either sign.
    Oracles in test_triangular: numpy's QR of everything at once.
    """
    if columns.size == 0:
        return factor
    grown, _, _, info = dtpqrt(0, min(_PANEL, len(factor)), factor, columns.T, overwrite_b=True)
    assert info == 0, "LAPACK rejects its arguments"
    return np.asarray(grown)


def triangular_factor(trials: Sequence[Trial], block_rows: int, start: Array | None = None) -> Array:
    """Return the upper triangular L' of [U_f; U_p; Y_p; Y_f] = L Q over the columns of all trials.

    ``start`` is the factor of earlier columns; no column crosses from one trial into the next.
    """
    n_inputs, n_outputs = trials[0][0].shape[1], trials[0][1].shape[1]
    inputs, window = block_rows * n_inputs, 2 * block_rows
    n_rows = window * (n_inputs + n_outputs)
    factor = empty_factor(n_rows) if start is None else start
    for u, y in trials:
        for first in range(0, len(u) - window + 1, COLUMNS_AT_ONCE):
            last = min(first + COLUMNS_AT_ONCE + window - 1, len(u))
            columns = np.empty((n_rows, last - first - window + 1))
            fill_hankel(columns[:inputs], u[first + block_rows : last])
            fill_hankel(columns[inputs : 2 * inputs], u[first:last])
            fill_hankel(columns[2 * inputs :], y[first:last])
            factor = accumulate(factor, columns)
    return factor
