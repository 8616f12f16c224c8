"""Correlated jitter and loss of Linux tc-netem, for comparison: written from its published description.

The manual page tc-netem(8) (S. Hemminger, "Network emulation with NetEm", 2005) defines each random number as rho
times the last one plus 1 - rho times a fresh one. Such a mixture of uniforms is not uniform: it is rarely near 0, so
the loss, which compares it with a threshold, is far below the requested one. The jitter uses the number's remainder
(the kernel's function tabledist), which wraps around many times, so it is uniform and has no correlation left.
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


def jitter(delay_ns: int, jitter_ns: int, x: Floats) -> NDArray[np.int64]:
    """Return delays in ns, (N,), for ``delay DELAY JITTER RHO`` without a table, from correlated x in [0, 1).

    The 32-bit number modulo twice the jitter, as the kernel reduces it; a jitter above 2 s would not wrap.
    """
    return np.floor(x * 2.0**32).astype(np.int64) % (2 * jitter_ns) - jitter_ns + delay_ns


def loss_with_correlation(n: int, p: float, rho: float, u: Floats) -> NDArray[np.bool_]:
    """Return which of ``n`` packets tc-netem loses for ``loss p rho``, (n,): those whose number is below ``p``.

    ``p`` and ``rho`` in 0..1. ``u`` are n + 1 uniforms in (0, 1); the recursion begins with the first. tc-netem
    computes x_i = ((2**32 - rho) u_i + rho x_{i-1}) / 2**32 in 32-bit fractions; here in real numbers (oracle:
    a loop in integers, tests/deploy/bench/test_tc_netem).
    """
    if len(u) != n + 1:
        raise ValueError(f"u must have n + 1 = {n + 1} numbers (got {len(u)})")
    return correlated_uniforms(u, rho)[1:] < p
