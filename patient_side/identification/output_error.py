"""B, D and the initial states by one linear least squares on the outputs, for given A and C.

With A and C fixed, ``y[k] = C A^k x0 + sum_{j<k} C A^(k-1-j) B u[j] + D u[k]`` is linear in x0, B and D. Every
response is a combination of the states of an orthonormal filter bank with A's poles (`orthonormal_basis`), the
same for all outputs: these states, the inputs and the outputs of each trial are reduced to one small triangle, and
only its rows are expanded over the p outputs.

An orthonormal filter basis with given poles: a chain of all-pass sections.

Every response of a system with state matrix A, for any B, C and initial state, is a combination of the n states of
such a chain with A's eigenvalues as poles (Takenaka and Malmquist 1925; Kautz 1954; Heuberger, Van den Hof and
Bosgra 1995, IEEE Trans. Autom. Control 40:451). The combination has the norm of the response, so that no choice of
coordinates makes the problem ill-conditioned, and a signal passes n filters instead of n p.

Stabilisation: eigenvalues move into the unit circle, as a filter on an unstable model diverges in gaps.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import schur

from tis.patient_side.filters.recursion import filtered
from tis.patient_side.identification.hankel import COLUMNS_AT_ONCE, accumulate, empty_factor
from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array, StateSpace


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


@dataclass(frozen=True)
class Section:
    """One real pole or a pair: ``x+ = A x + b v, next v = c x + d v`` with an orthogonal [A b; c d]."""

    A: Array
    b: Array
    c: Array
    d: float


@dataclass(frozen=True)
class OrthonormalBasis:
    """The chain, also as one system: ``g+ = A g + b v`` with A (n, n) block lower triangular, ``A A' + b b' = I``."""

    sections: tuple[Section, ...]
    A: Array
    b: Array

    @classmethod
    def with_poles(cls, matrix: Array) -> "OrthonormalBasis":
        """Return the basis for the eigenvalues of a stable ``matrix`` (n, n). Oracle: test_orthonormal_basis."""
        sections = tuple(_section(pole) for pole in np.linalg.eigvals(matrix) if pole.imag >= 0)
        n = len(matrix)
        A, b, through, at = np.zeros((n, n)), np.zeros(n), np.zeros(n), 0
        # The section's input is ``arriving`` times v plus ``through`` times the states before it.
        arriving = 1.0
        for section in sections:
            own = slice(at, at + len(section.b))
            A[own] = np.outer(section.b, through)
            A[own, own] += section.A
            b[own] = section.b * arriving
            through *= section.d
            through[own] = section.c
            arriving *= section.d
            at = own.stop
        return cls(sections, A, b)

    def states(self, signals: Array) -> Array:
        """Return the states (n, d, N) of d chains at rest, driven by ``signals`` (d, N), at each sample."""
        states, at = np.empty((len(self.b), *signals.shape)), 0
        for section in self.sections:
            n = len(section.b)
            for numerator, state in zip(_numerators(section), states[at : at + n], strict=True):
                state[:] = filtered(numerator, _denominator(section), signals)
            signals = section.d * signals
            for weight, state in zip(section.c, states[at : at + n], strict=True):
                signals += weight * state
            at += n
        return states

    def combination(self, A: Array, C: Array) -> Array:
        """Return the M (p, n, n) with ``C A^k e_j = sum_l M[:, l, j] g_l[k]``, where g is the impulse response.

        For an A with the basis's poles: ``Z = sum_k (C A^k)' g[k]'`` obeys ``Z = A' Z A_g' + C' b'``, solved section
        by section, as A_g is triangular.
        """
        n = len(A)
        result, at = np.empty((len(C), n, n)), 0
        for section in self.sections:
            own = slice(at, at + len(section.b))
            before = np.einsum("lk,okj->olj", self.A[own, :at], result[:, :at])
            right = before @ A + self.b[own, None] * C[:, None, :]
            system = np.eye(n * len(section.b)) - np.kron(section.A, A.T)
            solved = np.linalg.solve(system, right.reshape(len(C), -1).T)
            result[:, own] = solved.T.reshape(len(C), len(section.b), n)
            at = own.stop
        return result


def _section(pole: complex) -> Section:
    if pole.imag == 0:
        a, rest = pole.real, np.sqrt(1 - pole.real**2)
        return Section(np.array([[a]]), np.array([rest]), np.array([rest]), -float(a))
    # A pair in closed form. The Cholesky factor of the companion form's covariance fails on pairs close to 1, where
    # its two states are nearly equal; none of the differences here cancels.
    q = abs(pole) ** 2
    along, across = 2 * pole.real / (1 + q), abs(1 - pole) * abs(1 + pole) / (1 + q)
    gain = np.sqrt((1 - abs(pole)) * (1 + abs(pole)) * (1 + q))
    A = np.array([[along, -q * across], [across, q * along]])
    return Section(A, gain * np.array([across, -along]), np.array([0.0, gain]), float(q))


def _denominator(section: Section) -> Array:
    if len(section.b) == 1:
        return np.array([1.0, -section.A[0, 0]])
    return np.array([1.0, -np.trace(section.A), np.linalg.det(section.A)])


def _numerators(section: Section) -> list[Array]:
    A, b = section.A, section.b
    if len(b) == 1:
        return [np.array([0.0, b[0]])]
    return [
        np.array([0.0, b[0], A[0, 1] * b[1] - A[1, 1] * b[0]]),
        np.array([0.0, b[1], A[1, 0] * b[0] - A[0, 0] * b[1]]),
    ]


MAX_MODULUS = 0.999

STABLE_BELOW = 1 - 1e-9
"""Larger spectral radii count as unstable: so close to 1, rounding decides and responses do not decay."""

_MOVED_FROM = 1 - 1e-6
"""In an unstable A, moduli from here on are moved: eigenvalues by two algorithms may differ by as much."""


def stabilised(A: Array) -> tuple[Array, float]:
    """Return A with each eigenvalue of modulus r close to 1 or above moved to min(1/r, 0.999), and the radius before.

    Angles stay. The real Schur form is edited, not the eigenvectors, so repeated eigenvalues do no harm;
    where rounding leaves one of them outside, all eigenvalues are shrunk. An A of radius below `STABLE_BELOW` is
    returned unchanged, and every result has such a radius. Oracle: eigenvalues of constructed matrices.
    """
    radius = _radius(A)
    if radius < STABLE_BELOW:
        return A, radius
    T, Z = schur(A, output="real")
    # Along the diagonal: blocks of size 1 are real eigenvalues, of size 2 complex pairs of modulus sqrt(det).
    k = 0
    while k < len(T):
        pair = k + 1 < len(T) and T[k + 1, k] != 0
        size = 2 if pair else 1
        block = T[k : k + size, k : k + size]
        modulus = float(np.sqrt(abs(np.linalg.det(block)))) if pair else float(abs(block[0, 0]))
        if modulus >= _MOVED_FROM:
            T[k : k + size, k : k + size] = block * (min(1 / modulus, MAX_MODULUS) / modulus)
        k += size
    moved = np.asarray(Z @ T @ Z.T)
    while (left := _radius(moved)) >= STABLE_BELOW:
        moved = moved * (MAX_MODULUS / left)
    return moved, radius


def _radius(A: Array) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))
