"""Stabilisation: eigenvalues move into the unit circle, as a filter on an unstable model diverges in gaps."""

import numpy as np
from scipy.linalg import schur

from tis.patient_side.statespace import Array

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
