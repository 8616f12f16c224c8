"""How late a sample may be and still be worth a replay: asked of the model itself."""

import numpy as np

from patient_side.filters.innovations_filter import InnovationsFilter
from patient_side.filters.unbroken import Unbroken
from patient_side.statespace import Array

LONGEST_WINDOW = 32
_WORTH = 0.01
_ASKED = (1, 3, 6, 15)
_LONG_AGO = 300


def replay_window(filter_: InnovationsFilter, unbroken: Unbroken) -> int:
    """Return how many samples behind the newest a late one is still replayed; 0: late samples are left out.

    Suppose that every second sample is late, and that of the late ones the last W were replayed. W is the smallest
    from which on the deviation of a forecast, the mean over 1, 3, 6 and 15 samples ahead relative to that when none
    is missed, is within 1 % of the best; at most 32. What sensor noise makes worth it is thus said by the model,
    which holds the noise in its gain. Oracle: a model without memory, of which no late sample can tell anything.
    """
    horizons = [h for h in _ASKED if h <= filter_.horizon]

    def deviations(covariance: Array) -> Array:
        outputs, noise = filter_.spreading[horizons, -filter_.n_axes :], filter_.noise_now[horizons]
        spreads = outputs @ covariance @ outputs.transpose(0, 2, 1) + noise
        return np.asarray(np.sqrt(np.trace(spreads, axis1=1, axis2=2)))

    covariance, gap = filter_.start_covariance, min(2, filter_.horizon)
    for _ in range(_LONG_AGO):
        _, _, covariance = filter_.gain(covariance, gap)
    best = deviations(unbroken.covariances[unbroken.stage(gap * _LONG_AGO)])
    needed = 0
    for window in range(LONGEST_WINDOW):
        if np.mean(deviations(covariance) / best) > 1.0 + _WORTH:
            needed = window + 1
        _, _, covariance = filter_.gain(covariance, 1)
    return needed
