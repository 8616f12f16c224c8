"""A cache of the filter's covariances, which depend on which samples have arrived and not on their values.

In a network with jitter the same few gaps follow an unbroken row again and again. The covariance after a gap is
therefore stored with the one before it, in a tree whose roots are unbroken rows. The cache changes no result.
"""

from dataclasses import dataclass, field

import numpy as np

from tis.patient_side.filters.innovations_filter import InnovationsFilter
from tis.patient_side.statespace import Array

_MAX_DEPTH = 12
"""Samples after an unbroken row up to which covariances are stored: later ones hardly recur."""
_MAX_KEPT = 1000
_NONE = np.zeros((0, 0))


@dataclass(eq=False, slots=True)
class Uncertainty:
    """A covariance (M, M), ``depth`` samples after its root, and its successors by the gap to the next sample.

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

    def take(self, before: Uncertainty, gap: int) -> Uncertainty:
        """Return the covariance after a certain sample ``gap`` samples later. Oracle: the filter's own update."""
        kept = before.after
        if kept is not None:
            taken = kept.get(gap)
            if taken is not None:
                return taken
        weights, variance, covariance = self.filter.gain(before.covariance, gap)
        if before.depth >= _MAX_DEPTH:
            return Uncertainty(covariance, _MAX_DEPTH, weights, variance)
        if self._n_kept >= _MAX_KEPT:
            self._roots.clear()
            self._n_kept = 0
        if kept is None:
            kept = before.after = {}
        taken = kept[gap] = Uncertainty(covariance, before.depth + 1, weights, variance)
        self._n_kept += 1
        return taken
