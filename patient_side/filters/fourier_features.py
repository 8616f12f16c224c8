"""Random Fourier features: cosines of random projections, which together stand for a Gaussian kernel.

    cos(F f + phi),   F = N / (l s),   phi = 2 pi U - F m

N is normal, U uniform, m and s are mean and deviation of the inputs f in the training rows, and l is the kernel's
length (Rahimi and Recht 2007, "Random features for large-scale kernel machines").
"""

import numpy as np
from scipy.special import ndtri

from tis.common.streams import Stream
from tis.patient_side.statespace import Array

LENGTH = 3.5
"""Length of the kernel, in deviations of the inputs."""


def projections(centre: Array, deviation: Array, n_features: int) -> Array:
    """Return F and phi side by side (M, K + 1) for K inputs with these means and deviations.

    They are drawn from a fixed stream, so a model file does without them. Oracle: the Gaussian kernel.
    """
    n_inputs = len(centre)
    draws = Stream.named(0, "fourier features").uniforms(0, n_features * (n_inputs + 1))
    normal = ndtri(draws[n_features:]).reshape(n_features, n_inputs)
    frequencies = normal / (LENGTH * deviation)
    phases = 2.0 * np.pi * draws[:n_features] - frequencies @ centre
    return np.hstack([frequencies, phases[:, None]])
