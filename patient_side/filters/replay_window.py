"""The window of late samples worth a replay, from the model itself."""

import numpy as np

from tis.patient_side.filters.innovations_filter import InnovationsFilter
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.statespace import Array

MAX_WINDOW = 32
_TOLERANCE = 0.01
_HORIZONS = (1, 3, 6, 15)
_SETTLING_STEPS = 300


def replay_window(filter_: InnovationsFilter, unbroken: Unbroken) -> int:
    """Return how many samples behind the newest a late one is still replayed; 0: late samples are left out.

    Assume that every second sample is late, and that the last W late ones are replayed. W is the smallest number from
    which on a forecast's standard deviation, relative to that without late samples and averaged over 1, 3, 6 and 15
    samples ahead, stays within 1 % of the best; at most 32. The model's gain accounts for sensor noise.
    Oracle: a model without memory, for which late samples carry no information.
    """
    horizons = [h for h in _HORIZONS if h <= filter_.horizon]

    def deviations(covariance: Array) -> Array:
        outputs, noise = filter_.transitions[horizons, -filter_.n_axes :], filter_.noise_now[horizons]
        spreads = outputs @ covariance @ outputs.transpose(0, 2, 1) + noise
        return np.asarray(np.sqrt(np.trace(spreads, axis1=1, axis2=2)))

    # Steady state with every second sample, and the best that a row without gaps of the same duration reaches.
    covariance, gap = filter_.start_covariance, min(2, filter_.horizon)
    for _ in range(_SETTLING_STEPS):
        _, _, covariance = filter_.gain(covariance, gap)
    best = deviations(unbroken.covariances[unbroken.stage(gap * _SETTLING_STEPS)])
    # Every replayed late sample closes one gap.
    needed = 0
    for window in range(MAX_WINDOW):
        if np.mean(deviations(covariance) / best) > 1.0 + _TOLERANCE:
            needed = window + 1
        _, _, covariance = filter_.gain(covariance, 1)
    return needed
