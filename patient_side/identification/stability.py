"""Eigenvalues outside the unit circle are moved inside: a filter on an unstable model diverges when data fail."""

import numpy as np
from scipy.linalg import schur

from patient_side.statespace import Array

LARGEST_MODULUS = 0.999


def stabilised(A: Array) -> tuple[Array, float]:
    """Return A with each eigenvalue of modulus r >= 1 moved to min(1/r, 0.999), and the radius it had before.

    Angles stay. The real Schur form is edited, not the eigenvectors, so repeated eigenvalues do no harm. A
    stable A comes back unchanged. Oracle: eigenvalues of constructed matrices, test_stability.
    """
    radius = float(np.max(np.abs(np.linalg.eigvals(A)), initial=0.0))
    if radius < 1:
        return A, radius
    T, Z = schur(A, output="real")
    k = 0
    while k < len(T):
        pair = k + 1 < len(T) and T[k + 1, k] != 0
        size = 2 if pair else 1
        block = T[k : k + size, k : k + size]
        modulus = float(np.sqrt(abs(np.linalg.det(block)))) if pair else float(abs(block[0, 0]))
        if modulus >= 1:
            T[k : k + size, k : k + size] = block * (min(1 / modulus, LARGEST_MODULUS) / modulus)
        k += size
    return np.asarray(Z @ T @ Z.T), radius
