"""Correction of the bias from centring: a movement about its own mean seems to return to it too fast.

On a series about its own mean, least squares underestimate an autoregressive coefficient r by (1 + 3 r) / T over T
rows (Kendall 1954, "Note on bias in the estimation of autocorrelation", Biometrika 41:403; Marriott and Pope, ibid.
390). A random walk then looks like a movement that returns within a quarter of the trial, and so do forecasts over
some seconds. The correction applies only where it matters: to a decay so slow that a test does not reject a random
walk.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import eig

from patient_side.identification.innovations_form import InnovationsForm
from patient_side.statespace import Array

_UNIT_ROOT_5_PCT = 14.1
"""T (1 - r) above which a Dickey-Fuller test about a mean rejects a random walk, at 5 % (Fuller 1976, 8.5.1)."""

_MAX_DECAY = 10.0
"""Longest decay, in lengths of a trial: the rows carry no information on longer ones."""

_DEFECTIVE = 1e-6


def without_centring_bias(form: InnovationsForm, n_rows: float) -> InnovationsForm:
    """Return the model with its slowest decay corrected; other eigenvalues, gain and innovations are unchanged.

    ``n_rows`` is the length of a trial about its mean. The model is unchanged where the largest eigenvalue is not
    real and positive, where a random walk is rejected, and where the filter with the corrected A would be unstable.
    Oracle: forecasts of random walks, test_centring_bias.
    """
    A = corrected(form.A, n_rows)
    stable = not len(A) or float(np.max(np.abs(np.linalg.eigvals(A - form.K @ form.C)))) < 1.0
    return replace(form, A=A) if stable else form


def corrected(A: Array, n_rows: float) -> Array:
    """Return A with its slowest decay corrected where needed. Oracle: least squares on simulated random walks."""
    if not len(A):
        return A
    found: tuple[Array, Array, Array] = eig(A, left=True, right=True)  # type: ignore[assignment]
    values, left, right = found
    slowest = int(np.argmax(np.abs(values)))
    r = float(values[slowest].real)
    if values[slowest].imag != 0 or r <= 0 or n_rows * (1.0 - r) > _UNIT_ROOT_5_PCT:
        return A
    v, w = right[:, slowest].real, left[:, slowest].real
    product = float(w @ v)
    if abs(product) < _DEFECTIVE:
        return A
    # Move this eigenvalue alone: a rank-one change along its right and left eigenvectors.
    slower = max(r, min(r + (1.0 + 3.0 * r) / n_rows, 1.0 - 1.0 / (_MAX_DECAY * n_rows)))
    return np.asarray(A + (slower - r) * np.outer(v, w) / product)
