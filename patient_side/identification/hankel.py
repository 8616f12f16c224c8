"""Block Hankel matrices: each block row is the signal one sample later, channels of an instant together."""

from collections.abc import Iterator

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from patient_side.statespace import Array


def block_hankel(signal: Array, block_rows: int) -> Array:
    """Return the block Hankel matrix of ``signal`` (N, d), shape (block_rows * d, N - block_rows + 1).

    Block row i of column j is ``signal[i + j]`` (Verhaegen and Verdult, "Filtering and System
    Identification", section 9.2). Oracle: element-wise construction, test_hankel.
    """
    n_columns = len(signal) - block_rows + 1
    if n_columns < 1:
        return np.empty((block_rows * signal.shape[1], 0))
    windows = sliding_window_view(signal, block_rows, axis=0)
    return np.ascontiguousarray(windows.transpose(2, 1, 0).reshape(block_rows * signal.shape[1], n_columns))


def hankel_batches(signal: Array, block_rows: int, n_columns: int) -> Iterator[Array]:
    """Yield `block_hankel` in stretches of at most ``n_columns`` columns, so that memory is bounded."""
    total = len(signal) - block_rows + 1
    for first in range(0, total, n_columns):
        last = min(first + n_columns, total)
        yield block_hankel(signal[first : last + block_rows - 1], block_rows)
