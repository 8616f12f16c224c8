"""Band-limited noise as a function of continuous time: tremor, drift, slow turning."""

from typing import Final

import numpy as np

from tis.common.sources.trajectory import Array
from tis.common.streams import Stream

Band = tuple[float, float]
"""Lowest and highest frequency, in Hz."""

_N_SINES: Final = 10


def wander(stream: Stream, t_s: Array, band_hz: Band, std: float) -> Array:
    """Return three independent noises of standard deviation ``std`` at times (N,), shape (N, 3).

    Each is a sum of sinusoids of random phase (Rice, "Mathematical analysis of random noise", 1944), one of random
    frequency in each tenth of the band; in a narrow band they beat, as a tremor swells and fades. Oracle: size and
    spectrum of the tremor in the tests.
    """
    # A sine of amplitude 1 has variance 1/2, so n of them need the factor sqrt(2 / n).
    low_hz, high_hz = band_hz
    noise = np.zeros((3, len(t_s)))
    for axis, drawn in enumerate(stream.uniforms(0, 6 * _N_SINES).reshape(3, _N_SINES, 2)):
        for k, (place, turns) in enumerate(drawn):
            frequency_hz = low_hz + (k + place) / _N_SINES * (high_hz - low_hz)
            noise[axis] += np.sin(2.0 * np.pi * (frequency_hz * t_s + turns))
    return np.ascontiguousarray(std * np.sqrt(2.0 / _N_SINES) * noise.T)
