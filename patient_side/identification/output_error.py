"""B, D and the initial states by one linear least squares on the outputs, for given A and C.

With A and C fixed, ``y[k] = C A^k x0 + sum_{j<k} C A^(k-1-j) B u[j] + D u[k]`` is linear in x0, B and D.
The sums are worked out block by block, so that the cost per row does not grow and memory stays bounded.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from patient_side.identification.trials import Trial
from patient_side.statespace import Array

_BLOCK = 32
_BLOCKS_AT_ONCE = 64


def fit_inputs(A: Array, C: Array, trials: Sequence[Trial]) -> tuple[Array, Array, tuple[Array, ...]]:
    """Return B (n, m), D (p, m) and one x0 (n,) per trial that minimise the simulation error over all trials.

    Each trial's x0 is eliminated by a QR factorisation of that trial's rows alone; what remains of them is
    stacked under the triangular factor of the trials before. Verhaegen and Verdult, "Filtering and System
    Identification", section 9.2.4. Oracle: Markov parameters and responses of a known system, test_moesp.
    """
    n, m, p = len(A), trials[0][0].shape[1], len(C)
    common, starts = np.empty((0, n * m + p * m + 1)), []
    for u, y in trials:
        factor = _factor(A, C, u, y, feedthrough=True)
        starts.append(factor[:n])
        common = np.asarray(np.linalg.qr(np.vstack([common, factor[n:, n:]]), mode="r"))
    solution = np.linalg.lstsq(common[:, :-1], common[:, -1])[0]
    x0 = tuple(np.asarray(np.linalg.lstsq(rows[:, :n], rows[:, -1] - rows[:, n:-1] @ solution)[0]) for rows in starts)
    return _matrix(solution[: n * m], n, m), solution[n * m :].reshape(p, m), x0


def fit_response(A: Array, C: Array, trials: Sequence[Trial]) -> Array:
    """Return the B (n, m) that minimises the simulation error of all trials, from rest and with D = 0."""
    n, m = len(A), trials[0][0].shape[1]
    common = np.empty((0, n * m + 1))
    for u, y in trials:
        factor = _factor(A, C, u, y, feedthrough=False, start=False)
        common = np.asarray(np.linalg.qr(np.vstack([common, factor]), mode="r"))
    return _matrix(np.linalg.lstsq(common[:, :-1], common[:, -1])[0], n, m)


def _matrix(stacked: Array, n_rows: int, n_columns: int) -> Array:
    """Return the matrix whose columns are stacked in a vector."""
    return np.ascontiguousarray(stacked.reshape(n_columns, n_rows).T)


def _factor(A: Array, C: Array, u: Array, y: Array, *, feedthrough: bool, start: bool = True) -> Array:
    """Return the triangular factor of one trial's regression, the outputs in its last column."""
    n, p = len(A), len(C)
    skipped = 0 if start else n
    factor, first = None, 0
    for rows in _regressors(A, C, u, feedthrough):
        n_samples = len(rows) // p
        target = y[first : first + n_samples].reshape(-1, 1)
        block = np.hstack([rows[:, skipped:], target])
        stacked = block if factor is None else np.vstack([factor, block])
        factor = np.asarray(np.linalg.qr(stacked, mode="r"))
        first += n_samples
    assert factor is not None, "a trial has at least one row"
    return factor


def _regressors(A: Array, C: Array, u: Array, feedthrough: bool) -> Iterator[Array]:
    """Yield rows of the regression, (rows * p, n + n m [+ p m]): x0, then B by columns, then D by rows."""
    n, p, m, length = len(A), len(C), u.shape[1], _BLOCK
    powers = np.empty((length + 1, n, n))
    powers[0] = np.eye(n)
    for t in range(length):
        powers[t + 1] = A @ powers[t]
    observe = C @ powers[:length]  # (length, p, n): C A^t
    # what is known at a block's start: A^k, and for each input the states' responses to unit elements of B
    carried = np.hstack([np.eye(n), np.zeros((n, n * m))])
    for first in range(0, len(u), length * _BLOCKS_AT_ONCE):
        part = u[first : first + length * _BLOCKS_AT_ONCE]
        n_blocks = -(-len(part) // length)
        whole = np.zeros((n_blocks * length, m))
        whole[: len(part)] = part
        blocks = whole.reshape(n_blocks, length, m)
        at_start = np.empty((n_blocks, n, n + n * m))
        for b, block in enumerate(blocks):
            at_start[b] = carried
            carried = powers[length] @ carried
            added = np.tensordot(powers[length - 1 :: -1], block, axes=(0, 0))  # (n, n, m)
            carried[:, n:] += added.transpose(0, 2, 1).reshape(n, m * n)
        rows = np.zeros((n_blocks, length, p, n + n * m + (p * m if feedthrough else 0)))
        from_start = observe.reshape(length * p, n) @ at_start
        rows[..., : n + n * m] = from_start.reshape(n_blocks, length, p, n + n * m)
        # history[b, j, i, t] = u[j - 1 - t] of input i within block b, zero before the block
        padded = np.concatenate([np.zeros_like(blocks), blocks], axis=1)
        history = sliding_window_view(padded, length, axis=1)[:, :length, :, ::-1]
        within = history.reshape(-1, length) @ observe.reshape(length, p * n)
        within = within.reshape(n_blocks, length, m, p, n).transpose(0, 1, 3, 2, 4)
        rows[..., n : n + n * m] += within.reshape(n_blocks, length, p, m * n)
        if feedthrough:
            for output in range(p):
                begin = n + n * m + output * m
                rows[:, :, output, begin : begin + m] = blocks
        yield rows.reshape(n_blocks * length * p, -1)[: len(part) * p]
