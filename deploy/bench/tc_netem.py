"""Correlated jitter of Linux tc-netem, for comparison: written from its published description.

The manual page of tc-netem defines each random number as rho times the last one plus 1 - rho times a fresh one.
Such a mixture is not uniform: its variance is (1 - rho) / (1 + rho) of a uniform's; a jitter at 25 %
shrinks to 0.775.
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def correlated_uniforms(u: Floats, rho: float) -> Floats:
    """Return x_n = (1 - rho) u_n + rho x_(n-1) for uniforms (N,) in [0, 1) and rho in [0, 1); x_0 is u_0.

    Oracle: the variance (1 - rho) / (1 + rho) / 12 of a stationary autoregression.
    """
    x = np.empty(len(u))
    last = float(u[0]) if len(u) else 0.0
    for index, fresh in enumerate(u.tolist()):
        last = (1.0 - rho) * fresh + rho * last if index else fresh
        x[index] = last
    return x


def jitter(delay_ms: float, jitter_ms: float, x: Floats) -> Floats:
    """Return delays in ms, (N,), for ``delay DELAY JITTER`` without a table: x in [0, 1) spans DELAY +- JITTER."""
    return delay_ms + jitter_ms * (2.0 * x - 1.0)
