"""The dead time of each input, and inputs shifted by it.

The first coefficients of an ARX predictor are zero for the samples of dead time, however many lags it has; the first
one that noise does not explain ends it. Oracle: systems with known delays, test_input_delay.
"""

from collections.abc import Sequence

import numpy as np
from scipy.special import chdtri

from tis.patient_side.identification.arx import ArxFactor
from tis.patient_side.identification.trials import Trial
from tis.patient_side.linear_system import Array

_LEVEL = 1e-3
_RESOLUTION = 1e-6


def estimate_delay(trials: Sequence[Trial], lags: int) -> tuple[int, ...]:
    """Return each input's dead time in samples, beyond the one sample of a strictly proper system.

    ``trials`` are at unit deviation; at most ``lags - 1`` samples are found, and an input without any effect has 0.
    """
    found = ArxFactor.of(trials, lags)
    m, p = found.n_inputs, found.n_outputs
    regressors, outputs = found.factor[:, :-p], found.factor[:, -p:]
    coefficients = np.linalg.lstsq(regressors, outputs)[0]
    spread = np.diag(np.linalg.pinv(regressors.T @ regressors, hermitian=True))
    residual = found.residual(lags) + _RESOLUTION**2 * np.eye(p)
    squares = np.einsum("ci,ij,cj->c", coefficients, np.linalg.inv(residual), coefficients) / np.maximum(
        spread, 1e-300
    )
    limit = chdtri(p, _LEVEL / (m * (lags + 1)))
    delays = []
    for i in range(m):
        columns = [i, *(m + lag * (m + p) + p + i for lag in range(lags))]
        acts = np.flatnonzero(squares[columns] > limit)
        delays.append(max(0, int(acts[0]) - 1) if len(acts) else 0)
    return tuple(delays)


def delayed(u: Array, delay: Sequence[int]) -> Array:
    """Return the inputs (N, m) as they act; what came before the first row is NaN."""
    acting = np.full(u.shape, np.nan)
    for i, d in enumerate(delay):
        acting[d:, i] = u[: max(0, len(u) - d), i]
    return acting
