"""An orthonormal filter basis with given poles: a chain of all-pass sections.

Every response of a system with state matrix A, for any B, C and initial state, is a combination of the n states of
such a chain with A's eigenvalues as poles (Takenaka and Malmquist 1925; Kautz 1954; Heuberger, Van den Hof and
Bosgra 1995, IEEE Trans. Autom. Control 40:451). The combination has the norm of the response, so that no choice of
coordinates makes the problem ill-conditioned, and a signal passes n filters instead of n p.
"""

from dataclasses import dataclass

import numpy as np

from tis.patient_side.filters.recursion import filtered
from tis.patient_side.statespace import Array


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
