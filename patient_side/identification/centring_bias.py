"""How slowly a movement comes back to its level, about a mean that was taken from the same rows.

Of a series about its own mean, least squares find a decay that is too quick: an autoregressive coefficient r comes
out (1 + 3 r) / T too small over T rows (Kendall 1954, "Note on bias in the estimation of autocorrelation", Biometrika
41:403; Marriott and Pope, ibid. 390). A random walk so looks like a movement that returns within a quarter of the
trial, and forecasts of some seconds return with it. The correction is made where it counts: where the decay is so
slow that a test for a random walk does not reject one.
"""

from dataclasses import replace

import numpy as np
from scipy.linalg import eig

from patient_side.identification.innovations_form import InnovationsForm
from patient_side.statespace import Array

_UNIT_ROOT_5_PCT = 14.1
"""T (1 - r) from where on a Dickey-Fuller test about a mean rejects a random walk, at 5 % (Fuller 1976, 8.5.1)."""

_LONGEST_DECAY = 10.0
"""Longest decay, in lengths of a trial: of a longer one the rows tell nothing."""

_DEFECTIVE = 1e-6


def without_centring_bias(form: InnovationsForm, n_rows: float) -> InnovationsForm:
    """Return the model with its slowest decay corrected; other eigenvalues, gain and innovations stay.

    ``n_rows`` are those of a trial about its mean. The model stays as it is where the largest eigenvalue is not real
    and positive, where its decay is clearly quicker than a random walk's would be taken for, and where the gain would
    not do for the other A. Oracle: forecasts of random walks, test_centring_bias.
    """
    A = corrected(form.A, n_rows)
    stable = not len(A) or float(np.max(np.abs(np.linalg.eigvals(A - form.K @ form.C)))) < 1.0
    return replace(form, A=A) if stable else form


def corrected(A: Array, n_rows: float) -> Array:
    """Return A with its slowest decay corrected, if it is one. Oracle: least squares on simulated random walks."""
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
    slower = max(r, min(r + (1.0 + 3.0 * r) / n_rows, 1.0 - 1.0 / (_LONGEST_DECAY * n_rows)))
    return np.asarray(A + (slower - r) * np.outer(v, w) / product)
