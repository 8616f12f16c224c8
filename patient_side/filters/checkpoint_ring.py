"""Checkpoints of a filter at its last samples, from which it resumes when a late sample arrives.

A ring is an immutable tuple, oldest first, so that an estimator's state that holds it can be reused. It reaches back
to the last checkpoint before the window in which late samples are replayed.
"""

from typing import NamedTuple

from tis.patient_side.filters.activity import Activity
from tis.patient_side.filters.row_clock import NO_PHASE, Phasor
from tis.patient_side.filters.uncertainty import Uncertainty
from tis.patient_side.statespace import Array


class Checkpoint(NamedTuple):
    """The filter after the sample at source index ``source_index``: mean (M, 3/d) and uncertainty.

    Without an uncertainty the samples so far count as an unbroken row of ``length``; with one, ``length`` counts the
    samples of the arm since the row was broken. ``error`` (3, 3) is the covariance of a sample that entered the
    filter as if it were certain, ``activity`` the one after the innovations up to here, ``phasor`` that of the clock
    behind the rows.
    """

    source_index: int
    mean: Array
    uncertainty: Uncertainty | None
    length: int
    error: Array | None
    activity: Activity
    phasor: Phasor = NO_PHASE


Ring = tuple[Checkpoint, ...]


def rewound(ring: Ring, index: int) -> Ring:
    """Return the checkpoints before source index ``index``."""
    n = len(ring)
    while n and ring[n - 1].source_index >= index:
        n -= 1
    return ring[:n]


def trimmed(ring: Ring, window: int) -> Ring:
    """Return the checkpoints needed to replay samples up to ``window`` behind the newest: these and one before."""
    first, oldest = 0, ring[-1].source_index - window
    while first + 1 < len(ring) and ring[first + 1].source_index < oldest:
        first += 1
    return ring[first:]
