"""Replay of late samples: checkpoints of a filter, its covariances, and the window of samples worth a replay.

A cache of the filter's covariances, which depend on which samples have arrived and not on their values.

In a network with jitter the same few gaps follow an unbroken row again and again. The covariance after a gap is
therefore stored with the one before it, in a tree whose roots are unbroken rows. The cache changes no result.

Checkpoints of a filter at its last samples, from which it resumes when a late sample arrives.

A ring is an immutable tuple, oldest first, so that an estimator's state that holds it can be reused. It reaches back
to the last checkpoint before the window in which late samples are replayed.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tis.patient_side.filters.activity import Activity
from tis.patient_side.filters.innovations_filter import ARM, InnovationsFilter
from tis.patient_side.filters.row_clock import NO_PHASE, Phasor
from tis.patient_side.filters.unbroken import Unbroken
from tis.patient_side.linear_system import Array

_MAX_DEPTH = 12
"""Samples after an unbroken row up to which covariances are stored: later ones hardly recur."""
_MAX_KEPT = 1000
_NONE = np.zeros((0, 0))


@dataclass(eq=False, slots=True)
class Uncertainty:
    """A covariance (M, M), ``depth`` samples after its root, and its successors by the next sample: gap, and what.

    ``weights`` (M, d) is the Kalman gain of the certain sample that led to it, and ``variance`` the expected square
    of that sample's innovation; 0 where no sample led to it. Only ``after`` ever changes.
    """

    covariance: Array
    depth: int = _MAX_DEPTH
    weights: Array = field(default_factory=lambda: _NONE)
    variance: float = 0.0
    after: "dict[int, Uncertainty] | None" = None


@dataclass(eq=False)
class UncertaintyTree:
    """The stored covariances, by the stage of the unbroken row that they begin from."""

    filter: InnovationsFilter
    _roots: dict[int, Uncertainty] = field(default_factory=dict, repr=False)
    _n_kept: int = 0

    def root(self, stage: int, covariance: Array) -> Uncertainty:
        """Return the root of the tree of covariances that follow an unbroken row."""
        found = self._roots.get(stage)
        if found is None:
            found = self._roots[stage] = Uncertainty(covariance, 0)
        return found

    def take(self, before: Uncertainty, gap: int, what: int = ARM) -> Uncertainty:
        """Return the covariance after a certain sample of ``what`` ``gap`` samples later.

        Oracle: the filter's own update.
        """
        kept, key = before.after, 3 * gap + what
        if kept is not None:
            taken = kept.get(key)
            if taken is not None:
                return taken
        weights, variance, covariance = self.filter.gain(before.covariance, gap, None, what)
        if before.depth >= _MAX_DEPTH:
            return Uncertainty(covariance, _MAX_DEPTH, weights, variance)
        if self._n_kept >= _MAX_KEPT:
            self._roots.clear()
            self._n_kept = 0
        if kept is None:
            kept = before.after = {}
        taken = kept[key] = Uncertainty(covariance, before.depth + 1, weights, variance)
        self._n_kept += 1
        return taken


class Astray(NamedTuple):
    """An innovation of the arm that no command explains, and how many of them came in about its direction."""

    own: Array
    n: int


class Checkpoint(NamedTuple):
    """The filter after the sample at source index ``source_index``: mean (M, 3/d) and uncertainty.

    Without an uncertainty the samples so far count as an unbroken row of ``length``; with one, ``length`` counts the
    samples of the arm since the row was broken. ``error`` (3, 3) is the covariance of a sample that entered the
    filter as if it were certain, ``activity`` the one after the innovations up to here, ``phasor`` that of the clock
    behind the rows, ``jump`` the innovation of the sample where it was a jump, and ``astray`` the arm's own where no
    command explains it. The sample was stated at ``late`` periods after the plan's instant.
    """

    source_index: int
    mean: Array
    uncertainty: Uncertainty | None
    length: int
    error: Array | None
    activity: Activity
    phasor: Phasor = NO_PHASE
    jump: Array | None = None
    astray: Astray | None = None
    late: float = 0.0


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
