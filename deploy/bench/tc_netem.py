"""Correlated jitter and loss of Linux tc-netem, for comparison: written from its published description.

The manual page tc-netem(8) (S. Hemminger, "Network emulation with NetEm", 2005) defines each random number as rho
times the last one plus 1 - rho times a fresh one. Such a mixture of uniforms is not uniform: its variance shrinks to
(1 - rho) / (1 + rho) of a uniform's, so a jitter at 25 % shrinks to 0.775, and it is rarely near 0, so the loss is
far below the requested one.
"""

import numpy as np
import scipy
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def correlated_uniforms(u: Floats, rho: float) -> Floats:
    """Return x_n = (1 - rho) u_n + rho x_(n-1) for uniforms (N,) in [0, 1) and rho in [0, 1); x_0 is u_0.

    Oracle: the variance (1 - rho) / (1 + rho) / 12 of a stationary autoregression.
    """
    if len(u) < 2:
        return u
    x, _ = scipy.signal.lfilter([1.0 - rho], [1.0, -rho], u[1:], zi=[rho * u[0]])
    return np.concatenate([u[:1], x])


def jitter(delay_ms: float, jitter_ms: float, x: Floats) -> Floats:
    """Return delays in ms, (N,), for ``delay DELAY JITTER`` without a table: x in [0, 1) spans DELAY +- JITTER."""
    return delay_ms + jitter_ms * (2.0 * x - 1.0)


def loss_with_correlation(n: int, p: float, rho: float, u: Floats) -> NDArray[np.bool_]:
    """Return which of ``n`` packets tc-netem loses for ``loss p rho``, (n,): those whose number is below ``p``.

    ``p`` and ``rho`` in 0..1. ``u`` are n + 1 uniforms in (0, 1); the recursion begins with the first. tc-netem
    computes x_i = ((2**32 - rho) u_i + rho x_{i-1}) / 2**32 in 32-bit fractions; here in real numbers (oracle:
    a loop in integers, tests/deploy/bench/test_tc_netem).
    """
    if len(u) != n + 1:
        raise ValueError(f"u must have n + 1 = {n + 1} numbers (got {len(u)})")
    return correlated_uniforms(u, rho)[1:] < p
