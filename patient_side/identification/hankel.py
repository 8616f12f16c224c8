"""Block Hankel matrices: each block row is the signal shifted by one sample."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from tis.patient_side.statespace import Array


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
    if n_columns == 0:
        return
    block_rows = len(matrix) // n_channels
    # Channel by channel in memory, so that whole rows are copied.
    channels = np.ascontiguousarray(signal[: n_columns + block_rows - 1].T)
    windows = sliding_window_view(channels, n_columns, axis=1)
    matrix.reshape(block_rows, n_channels, n_columns)[:] = windows.transpose(1, 0, 2)
