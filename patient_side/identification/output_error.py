"""B, D and the initial states by one linear least squares on the outputs, for given A and C.

With A and C fixed, ``y[k] = C A^k x0 + sum_{j<k} C A^(k-1-j) B u[j] + D u[k]`` is linear in x0, B and D. Every
response is a combination of the states of an orthonormal filter bank with A's poles (`orthonormal_basis`), the
same for all outputs: these states, the inputs and the outputs of each trial are reduced to one small triangle, and
only its rows are expanded over the p outputs.
"""

from collections.abc import Sequence

import numpy as np

from tis.patient_side.identification.orthonormal_basis import OrthonormalBasis
from tis.patient_side.identification.trials import Trial
from tis.patient_side.identification.triangular import COLUMNS_AT_ONCE, accumulate, empty_factor
from tis.patient_side.statespace import Array, StateSpace


def fit_inputs(A: Array, C: Array, trials: Sequence[Trial]) -> tuple[Array, Array, tuple[Array, ...]]:
    """Return B (n, m), D (p, m) and one x0 (n,) per trial that minimise the simulation error over all trials.

    A must be stable. Each trial's x0 is eliminated by a QR factorisation of that trial's rows alone; the remaining
    rows are stacked under the triangular factor of the trials before. Verhaegen and Verdult, "Filtering and
    System Identification", section 9.2.4. Oracles: least squares on unit simulations, test_output_error.
    """
    n, m, p = len(A), trials[0][0].shape[1], len(C)
    basis = OrthonormalBasis.with_poles(A)
    combination = basis.combination(A, C)
    common, starts = np.empty((0, n * m + p * m + 1)), []
    for u, y in trials:
        # The response to x0 is that to an impulse before the first row.
        signals = np.zeros((m + 1, len(u) + 1))
        signals[0, 0] = 1.0
        signals[1:, 1:] = u.T
        states = basis.states(signals)[:, :, 1:]
        small = _triangle([states[:, 0], *(states[:, i + 1] for i in range(m)), u.T, y.T])
        rows = _spread(small, combination, m, feedthrough=True)
        factor = np.asarray(np.linalg.qr(rows, mode="r"))
        starts.append(factor[:n])
        common = np.asarray(np.linalg.qr(np.vstack([common, factor[n:, n:]]), mode="r"))
    solution = np.linalg.lstsq(common[:, :-1], common[:, -1])[0]
    x0 = tuple(np.asarray(np.linalg.lstsq(rows[:, :n], rows[:, -1] - rows[:, n:-1] @ solution)[0]) for rows in starts)
    return _matrix(solution[: n * m], n, m), solution[n * m :].reshape(p, m), x0


def fit_inputs_by_innovations(
    A: Array, C: Array, gain: Array, trials: Sequence[Trial]
) -> tuple[Array, Array, tuple[Array, ...]]:
    """Return B, D and x0 as `fit_inputs` does, for the least one-step errors of the filter with a ``gain`` (n, p).

    Slow disturbances, which a simulation cannot know, then weigh no more than others. A - K C must be stable. Oracle:
    least squares on a plain loop's errors, test_output_error.
    """
    observer = StateSpace(A - gain @ C, gain, C, np.zeros((len(C), len(C))))
    rest = [(u, y - observer.simulate(y)) for u, y in trials]
    B, D, x0 = fit_inputs(observer.A, C, rest)
    return B + gain @ D, D, x0


def fit_response(A: Array, C: Array, trials: Sequence[Trial]) -> Array:
    """Return the B (n, m) that minimises the simulation error of all trials, from rest and with D = 0."""
    n, m = len(A), trials[0][0].shape[1]
    basis = OrthonormalBasis.with_poles(A)
    small = empty_factor(n * m + len(C))
    for u, y in trials:
        states = basis.states(np.ascontiguousarray(u.T))
        small = _triangle([*(states[:, i] for i in range(m)), y.T], small)
    rows = _spread(small, basis.combination(A, C), m, feedthrough=False)
    return _matrix(np.asarray(np.linalg.lstsq(rows[:, :-1], rows[:, -1])[0]), n, m)


def _triangle(parts: Sequence[Array], start: Array | None = None) -> Array:
    """Return the triangular factor of stacked signals (d_i, N)."""
    d, n_columns = sum(len(part) for part in parts), parts[0].shape[1]
    factor = empty_factor(d) if start is None else start
    for first in range(0, n_columns, COLUMNS_AT_ONCE):
        factor = accumulate(factor, np.concatenate([part[:, first : first + COLUMNS_AT_ONCE] for part in parts]))
    return factor


def _spread(small: Array, combination: Array, n_inputs: int, *, feedthrough: bool) -> Array:
    """Return the regression's rows: x0 [with feedthrough], B by columns, [D by rows,] and the output.

    ``small`` has columns for the states of each chain, the inputs if ``feedthrough``, and the outputs.
    """
    p, n, m = len(combination), combination.shape[1], n_inputs
    n_chains = m + (1 if feedthrough else 0)
    d = len(small)
    rows = np.zeros((p, d, n_chains * n + (p * m if feedthrough else 0) + 1))
    chains = small[:, : n_chains * n].reshape(d, n_chains, n)
    rows[:, :, : n_chains * n] = np.einsum("dcl,olj->odcj", chains, combination).reshape(p, d, n_chains * n)
    for output in range(p):
        if feedthrough:
            begin = n_chains * n + output * m
            rows[output, :, begin : begin + m] = small[:, n_chains * n : n_chains * n + m]
        rows[output, :, -1] = small[:, d - p + output]
    return rows.reshape(p * d, -1)


def _matrix(stacked: Array, n_rows: int, n_columns: int) -> Array:
    """Return the matrix whose columns are stacked in a vector."""
    return np.ascontiguousarray(stacked.reshape(n_columns, n_rows).T)
