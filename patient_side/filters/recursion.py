"""A linear filter over whole signals: its recursion is a banded triangular system, which LAPACK solves."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

Numbers = NDArray[Any]


def filtered(numerator: Numbers, denominator: Numbers, signals: Numbers) -> Numbers:
    """Return the d signals (d, N), at rest before the first sample, behind a filter whose denominator begins with 1.

    Numbers may be complex. `scipy.signal.lfilter`, the oracle, takes longer to load than the rest of the patient.
    """
    driven = np.zeros(signals.shape, dtype=np.result_type(numerator, denominator, signals))
    for lag, weight in enumerate(numerator):
        if weight:
            driven[:, lag:] += weight * signals[:, : signals.shape[1] - lag]
    bands = np.repeat(denominator[:, None], signals.shape[1], axis=1)
    solve: Any = get_lapack_funcs("tbtrs", (bands, driven))
    return np.asarray(solve(bands, driven.T, uplo="L", diag="U")[0].T)
