"""The frequency of the clock behind the rows, from the evidence of training rows."""

from collections.abc import Sequence
from math import log

import numpy as np

from patient_side.statespace import Array

_RESOLUTION = 32768
_MIN_SHARE = 0.05
_CHANCE = 10.0
"""A line of chance exceeds log(frequencies) by this much with a probability of e^-10."""
_LOWEST = 0.02


def find_row_clock(evidence: Sequence[Array]) -> float:
    """Return the frequency in cycles per row of a line in the spectra of ``evidence`` (N_i,), 0 where there is none.

    The line is at the same frequency in all recordings, with a phase of its own in each. It must hold a twentieth of
    the evidence's power, as the pattern of a recorder's clock does and human movement does not, and more than a line
    of chance. Recordings of rows on an even clock have none. Oracle: rows picked from a source of known rate.
    """
    used = [each for each in evidence if len(each) and np.any(each)]
    if not used:
        return 0.0
    # Power of the best sinusoid at each frequency, per recording; its share of the whole power.
    frequencies = np.fft.rfftfreq(_RESOLUTION)
    power = np.zeros(len(frequencies))
    for each in used:
        for first in range(0, len(each), _RESOLUTION):
            part = each[first : first + _RESOLUTION]
            power += 2.0 * np.square(np.abs(np.fft.rfft(part, _RESOLUTION))) / len(part)
    power[frequencies < _LOWEST] = 0.0
    at = int(power.argmax())
    n_rows = sum(map(len, used))
    whole = sum(float(each @ each) for each in used)
    share = float(power[at]) / whole
    by_chance = 2.0 * (len(used) + log(n_rows / 2 + 1) + _CHANCE) / n_rows
    return float(frequencies[at]) if share > max(_MIN_SHARE, by_chance) else 0.0
