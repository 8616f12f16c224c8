"""What Linux tc-netem loses when it is asked for a correlated loss: the comparison for this emulator's models.

Written from the published description of the algorithm (tc-netem(8); S. Hemminger, "Network emulation with NetEm",
2005): each random number is a weighted mean of a fresh uniform one and of the one before, and a packet is lost when
it is below the probability asked for. A mean of uniforms is not uniform, it seldom comes near 0, so the share that
is lost falls far below the one asked for; and neighbours that are alike are all that the correlation is about.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter


def loss_with_correlation(n: int, p: float, rho: float, u: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Return which of ``n`` packets are lost when tc-netem is asked for ``loss p rho``, (n,).

    ``p`` and ``rho`` in 0..1. ``u`` are n + 1 uniforms in (0, 1), the first of which the recursion begins with.
    tc-netem computes x_i = ((2**32 - rho) u_i + rho x_{i-1}) / 2**32 in 32-bit fractions; here it is the same in
    real numbers (oracle: a loop in integers, tests/deploy/bench/test_tc_netem_loss).
    """
    if len(u) != n + 1:
        raise ValueError(f"u must have n + 1 = {n + 1} numbers (got {len(u)})")
    x, _ = lfilter([1.0 - rho], [1.0, -rho], u[1:], zi=[rho * u[0]])
    return np.asarray(x < p)
