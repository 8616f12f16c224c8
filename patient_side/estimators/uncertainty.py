"""Covariances of the filter that are not worked out twice: they depend on which samples came, not on their values.

From an unbroken row the same few gaps come again and again in a network that jitters. So what a gap leads to is kept
with the covariance that it begins from, a tree whose roots are unbroken rows. What is kept changes no result.
"""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from patient_side.innovations_filter import InnovationsFilter
from patient_side.statespace import Array

_DEEPEST = 12
"""Samples after an unbroken row up to which covariances are kept: later ones hardly come again."""
_MOST_KEPT = 1000


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """A covariance (N, N), and what follows it by the gap to the next sample; ``depth`` samples after its root."""

    covariance: Array
    depth: int = _DEEPEST
    after: dict[int, "Taken"] = field(default_factory=dict, repr=False)


class Taken(NamedTuple):
    """What a certain sample does: gain (N, 3), what its innovation's square is expected to be, and what is left."""

    gain: Array
    variance: float
    left: Uncertainty


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

    def take(self, before: Uncertainty, gap: int) -> Taken:
        """Return what a certain sample ``gap`` samples later does. Oracle: the filter's own update."""
        taken = before.after.get(gap)
        if taken is not None:
            return taken
        updated = self.filter.gain(before.covariance, gap)
        left = Uncertainty(updated.covariance, min(before.depth + 1, _DEEPEST))
        taken = Taken(np.ascontiguousarray(updated.weights.T), updated.variance, left)
        if before.depth < _DEEPEST:
            if self._n_kept >= _MOST_KEPT:
                self._roots.clear()
                self._n_kept = 0
            before.after[gap] = taken
            self._n_kept += 1
        return taken
