"""The normal distribution truncated from below: the result of redrawing every value below a bound.

Johnson, Kotz, Balakrishnan, "Continuous Univariate Distributions", vol. 1, section 13.10.1.
"""

from math import pi, sqrt
from typing import Final

import numpy as np
import scipy

from tis.netem.draws.blocks import Floats

MIN_STD_NS: Final = 1e-6  # delays are rounded to 1 ns: less is no spread, and would overflow the ratios below


def quantile_above(u: Floats, mean_ns: float, std_ns: float, lower_ns: Floats | float) -> Floats:
    """Return the quantiles of N(mean, std^2) given that it is at least ``lower_ns``, shape of ``u``.

    ``u`` lies in (0, 1); ``lower_ns`` must not exceed ``mean_ns``. Without spread all values are ``mean_ns``. Each
    value needs one uniform, so a redraw does not shift another packet's draws (oracle: scipy.stats.truncnorm,
    test_latency).
    """
    if std_ns < MIN_STD_NS:
        return np.full(np.shape(u), mean_ns)
    above = scipy.special.ndtr((mean_ns - lower_ns) / std_ns)
    below, beyond = 1.0 - above + u * above, (1.0 - u) * above
    # by the smaller of the two tails: ndtri cannot resolve probabilities near 1
    z = scipy.special.ndtri(np.minimum(below, beyond))
    return np.maximum(mean_ns + std_ns * np.where(below < beyond, z, -z), lower_ns)


def cdf_above(x_ns: Floats, mean_ns: float, std_ns: float, lower_ns: Floats | float) -> Floats:
    """Return P(X <= x) of N(mean, std^2) given that it is at least ``lower_ns``, shape of ``x_ns``.

    ``lower_ns`` must not exceed ``mean_ns``. Oracle: the inverse of `quantile_above`,
    tests/netem/stages/delay/test_truncated_normal.
    """
    if std_ns < MIN_STD_NS:
        return np.asarray(x_ns >= mean_ns, np.float64)
    above = scipy.special.ndtr((mean_ns - lower_ns) / std_ns)
    beyond = scipy.special.ndtr((mean_ns - np.maximum(x_ns, lower_ns)) / std_ns)
    return np.asarray(1.0 - beyond / above)


def moments_above(mean_ns: float, std_ns: float, lower_ns: Floats | float) -> tuple[Floats, Floats]:
    """Return mean (ns) and variance (ns^2) of N(mean, std^2) given that it is at least ``lower_ns``, in its shape."""
    bound_ns = np.asarray(lower_ns, np.float64)
    if std_ns < MIN_STD_NS:
        return np.full(bound_ns.shape, mean_ns), np.zeros(bound_ns.shape)
    alpha = (bound_ns - mean_ns) / std_ns
    hazard = np.exp(-alpha * alpha / 2.0) / sqrt(2.0 * pi) / scipy.special.ndtr(-alpha)
    return mean_ns + std_ns * hazard, std_ns * std_ns * (1.0 + alpha * hazard - hazard * hazard)
