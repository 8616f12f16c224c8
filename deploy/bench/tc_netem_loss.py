"""Correlated loss of Linux tc-netem, for comparison with this emulator's models.

Written from the published description of the algorithm (tc-netem(8); S. Hemminger, "Network emulation with NetEm",
2005): each random number is a weighted mean of a fresh uniform one and the one before, and a packet is lost when it
is below the requested probability. A mean of uniforms is not uniform and is rarely near 0, so the realised loss is
far below the requested one.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter


def loss_with_correlation(n: int, p: float, rho: float, u: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of ``n`` packets tc-netem loses for ``loss p rho``, (n,).

    ``p`` and ``rho`` in 0..1. ``u`` are n + 1 uniforms in (0, 1); the recursion begins with the first. tc-netem
    computes x_i = ((2**32 - rho) u_i + rho x_{i-1}) / 2**32 in 32-bit fractions; here in real numbers (oracle:
    a loop in integers, tests/deploy/bench/test_tc_netem_loss).
    """
    if len(u) != n + 1:
        raise ValueError(f"u must have n + 1 = {n + 1} numbers (got {len(u)})")
    x, _ = lfilter([1.0 - rho], [1.0, -rho], u[1:], zi=[rho * u[0]])
    return np.asarray(x < p)
