"""Eigenvalues outside the unit circle are moved inside: a filter on an unstable model diverges when data fail."""

import numpy as np
from scipy.linalg import schur

from patient_side.statespace import Array

LARGEST_MODULUS = 0.999

STABLE_BELOW = 1 - 1e-9
"""Spectral radii from here on count as unstable: so close to 1 rounding decides, and responses never settle."""

_MOVED_FROM = 1 - 1e-6
"""Moduli from here on are moved, once one is: two algorithms' eigenvalues may differ by as much."""


def stabilised(A: Array) -> tuple[Array, float]:
    """Return A with each eigenvalue of modulus r close to 1 or above moved to min(1/r, 0.999), and the radius before.

    Angles stay. The real Schur form is edited, not the eigenvectors, so repeated eigenvalues do no harm; what they
    leave outside by rounding, all eigenvalues are shrunk for. An A of radius below `STABLE_BELOW` comes back
    unchanged, any other with one. Oracle: eigenvalues of constructed matrices, test_stability.
    """
    radius = _radius(A)
    if radius < STABLE_BELOW:
        return A, radius
    T, Z = schur(A, output="real")
    k = 0
    while k < len(T):
        pair = k + 1 < len(T) and T[k + 1, k] != 0
        size = 2 if pair else 1
        block = T[k : k + size, k : k + size]
        modulus = float(np.sqrt(abs(np.linalg.det(block)))) if pair else float(abs(block[0, 0]))
        if modulus >= _MOVED_FROM:
            T[k : k + size, k : k + size] = block * (min(1 / modulus, LARGEST_MODULUS) / modulus)
        k += size
    moved = np.asarray(Z @ T @ Z.T)
    while (left := _radius(moved)) >= STABLE_BELOW:
        moved = moved * (LARGEST_MODULUS / left)
    return moved, radius


def _radius(A: Array) -> float:
    return float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))
