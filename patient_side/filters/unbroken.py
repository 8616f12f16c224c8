"""The filter while every sample of the arm arrives: precomputed covariances and gains.

They depend on *which* samples have arrived and not on their values. In an unbroken row of samples they depend on its
length alone, so they are computed in advance and a step is one product of a matrix and a vector. The model's states
converge within a second; a level, which is a mean, converges over minutes, ever more slowly. Lengths are therefore
distinguished one by one up to 50 samples, and to 2 % beyond.

A broken row counts as unbroken again once its covariances match those of an unbroken one, whose length it then has.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from tis.patient_side.filters.innovations_filter import InnovationsFilter
from tis.patient_side.linear_system import Array

_EVERY_LENGTH_UP_TO = 50
_RATIO = 1.02
_SPREAD_RATIO = 1.35
_MAX_LENGTH = 6000
_CHECK_EVERY = 8
_CONVERGED = 1e-14
_ALIKE = 0.03
"""Covariances match when no entry differs by more, in units of the deviations of row and column ..."""
_NEGLIGIBLE = 1e-3
"""... and of those that one sample's noise adds."""


@dataclass(frozen=True, eq=False)
class Unbroken:
    """Stages of an unbroken row: ``lengths`` (S,) at which they begin, covariance and gain of the sample there.

    ``covariances`` (S, M, M) hold after the sample, ``gains`` (M, d) are its Kalman gains and ``variances`` (S,) the
    expected squares of its innovation. ``stage_of`` maps a length to its stage, and ``spread_stage_of`` to the stage
    whose covariance its forecasts use; longer rows belong to the last stage.
    """

    lengths: tuple[int, ...]
    covariances: Array
    gains: tuple[Array, ...]
    variances: tuple[float, ...]
    stage_of: tuple[int, ...]
    spread_stage_of: tuple[int, ...]
    _level: Array | None
    _level_variances: tuple[float, ...]
    _alike: Array
    _n_past: int = 0

    @classmethod
    def of(cls, filter_: InnovationsFilter, longest: int = _MAX_LENGTH) -> "Unbroken":
        """Run the filter's covariances over a row of ``longest`` samples. Oracle: the filter itself.

        The covariance of a model without a level converges to zero; longer rows differ by rounding only.
        """
        d, covariance = filter_.n_axes, filter_.start_covariance
        lengths, covariances, stage_of = [1], [covariance], [0, 0]
        gains, variances = [np.zeros((filter_.n_states, d))], [1.0]
        # The past does not count: it is known, or of no consequence for the covariances of forecasts.
        n_past = filter_.n_past
        added = np.sqrt(np.diag(filter_.noises[1]))
        nothing = _CONVERGED * np.outer(added, added)[n_past:, n_past:]
        for length in range(2, longest + 1):
            weights, variance, covariance = filter_.gain(covariance, 1)
            if length <= _EVERY_LENGTH_UP_TO or length >= _RATIO * lengths[-1]:
                lengths.append(length)
                covariances.append(covariance)
                gains.append(weights)
                variances.append(variance)
            stage_of.append(len(lengths) - 1)
            if (
                filter_.level is None
                and length % _CHECK_EVERY == 0
                and _within(covariance[n_past:, n_past:], nothing)
            ):
                break
        # Each covariance keeps the Fortran order that BLAS reads without a copy in the filter's gain.
        stacked = np.array([each.T for each in covariances]).transpose(0, 2, 1)
        level = None if filter_.level is None else filter_.level[0]
        # Tolerances of a match; infinite for what is certain and differs by rounding only.
        inner = slice(n_past, -(filter_.n_following + d))
        known = np.sqrt(np.maximum(np.diagonal(stacked, axis1=1, axis2=2)[:, inner], 0.0))
        alike = np.full_like(stacked, np.inf)
        alike[:, inner, inner] = _ALIKE * known[:, :, None] * known[:, None, :]
        alike[:, inner, inner] += _NEGLIGIBLE * np.outer(added, added)[inner, inner]
        return cls(
            tuple(lengths),
            stacked,
            tuple(gains),
            tuple(variances),
            tuple(stage_of),
            tuple(_coarse(lengths, stage_of)),
            level,
            () if level is None else tuple(-_level_variance(each, level) for each in stacked),
            alike,
            n_past,
        )

    def stage(self, length: int) -> int:
        """Return the stage of an unbroken row of ``length`` samples."""
        return self.stage_of[length] if length < len(self.stage_of) else len(self.lengths) - 1

    def spread_stage(self, length: int) -> int:
        """Return the stage whose covariance forecasts after a row of ``length`` samples use: a shorter row's.

        Lengths are distinguished by a ratio of 1.35 only, so that forecasts can be cached; only the level differs.
        """
        return self.spread_stage_of[min(length, len(self.spread_stage_of) - 1)]

    def length_like(self, covariance: Array) -> int:
        """Return the length of the unbroken row with the same covariance (M, M), or 0 where none has it."""
        stage = len(self.lengths) - 1
        if self._level is not None:
            # The level's variance falls with the length; negated, it is sorted for the bisection.
            stage = bisect_right(self._level_variances, -_level_variance(covariance, self._level)) - 1
            if stage < 0:
                return 0
        own, alike = self.covariances[stage], self._alike[stage]
        first = self._n_past, self._n_past  # the model's first entry decides most cases
        if abs(covariance.item(*first) - own.item(*first)) > alike.item(*first):
            return 0
        difference = np.abs(covariance - own)
        return self.lengths[stage] if np.count_nonzero(difference <= alike) == alike.size else 0


def _within(covariance: Array, bound: Array) -> bool:
    return bool(np.all(np.abs(covariance) <= bound))


def _level_variance(covariance: Array, level: Array) -> float:
    """Return the variance of the level, which ``level`` (M,) maps from the state, under a covariance (M, M)."""
    return float(level @ covariance @ level)


def _coarse(lengths: list[int], stage_of: list[int]) -> list[int]:
    """Return for each length the stage that it shares with lengths up to `_SPREAD_RATIO` times as long."""
    first, coarse = 0, []
    for stage in stage_of:
        if lengths[stage] <= _EVERY_LENGTH_UP_TO or lengths[stage] >= _SPREAD_RATIO * lengths[first]:
            first = stage
        coarse.append(first)
    return coarse
