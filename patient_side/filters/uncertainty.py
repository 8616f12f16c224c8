"""Covariances of the filter that are not worked out twice: they depend on which samples came, not on their values.

From an unbroken row the same few gaps come again and again in a network that jitters. So what a gap leads to is kept
with the covariance that it begins from, a tree whose roots are unbroken rows. What is kept changes no result.
"""

from dataclasses import dataclass, field

import numpy as np

from patient_side.filters.innovations_filter import InnovationsFilter
from patient_side.statespace import Array

_DEEPEST = 12
"""Samples after an unbroken row up to which covariances are kept: later ones hardly come again."""
_MOST_KEPT = 1000
_NONE = np.zeros((0, 0))


@dataclass(eq=False, slots=True)
class Uncertainty:
    """A covariance (M, M), ``depth`` samples after its root, and what follows it by the gap to the next sample.

    ``weights`` (N, 3) are those of the innovation of the sample that left it, a certain one, and ``variance`` is what
    the innovation's square was expected to be; 0 where no sample led there. Nothing of it is changed but ``after``.
    """

    covariance: Array
    depth: int = _DEEPEST
    weights: Array = field(default_factory=lambda: _NONE)
    variance: float = 0.0
    after: "dict[int, Uncertainty] | None" = None


@dataclass(eq=False)
class UncertaintyTree:
    """The covariances kept, by the stage of the unbroken row that they begin from."""

    filter: InnovationsFilter
    _roots: dict[int, Uncertainty] = field(default_factory=dict, repr=False)
    _n_kept: int = 0

    def root(self, stage: int, covariance: Array) -> Uncertainty:
        """Return the covariance of an unbroken row as one that others may follow."""
        found = self._roots.get(stage)
        if found is None:
            found = self._roots[stage] = Uncertainty(covariance, 0)
        return found

    def take(self, before: Uncertainty, gap: int) -> Uncertainty:
        """Return what a certain sample ``gap`` samples later leaves. Oracle: the filter's own update."""
        kept = before.after
        if kept is not None:
            taken = kept.get(gap)
            if taken is not None:
                return taken
        weights, variance, covariance = self.filter.gain(before.covariance, gap)
        if before.depth >= _DEEPEST:
            return Uncertainty(covariance, _DEEPEST, weights, variance)
        if self._n_kept >= _MOST_KEPT:
            self._roots.clear()
            self._n_kept = 0
        if kept is None:
            kept = before.after = {}
        taken = kept[gap] = Uncertainty(covariance, before.depth + 1, weights, variance)
        self._n_kept += 1
        return taken
