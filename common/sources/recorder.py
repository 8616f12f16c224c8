"""The recorder of JIGSAWS: rows that show its latest sample, one or two samples apart."""

import numpy as np

from common.sources.trajectory import Array


def latest_sample_s(t_s: Array, recorder_hz: float, phase: float) -> Array:
    """Return the instants (N,) in s of a recorder's latest samples at or before the instants ``t_s`` (N,), in s.

    The recorder samples at ``(j - phase) / recorder_hz`` for all integers j; ``phase`` is in [0, 1). Where
    ``recorder_hz`` is a multiple of the rows' rate, all rows are late by the same ``phase / recorder_hz``. Oracle:
    literal sample numbers; a search among the recorder's instants.
    """
    return np.asarray((np.floor(t_s * recorder_hz + phase) - phase) / recorder_hz)
