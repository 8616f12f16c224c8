"""The filter while every sample of the arm arrives: covariances and gains that no data change.

They depend on *which* samples have arrived and not on their values. In an unbroken row of samples they depend on its
length alone, so they are worked out beforehand and a step is one product of a matrix and a vector. What moves is
known within a second; a level, which is a mean, is learnt for minutes, ever slower. So lengths are told apart one by
one up to 50 samples, and to 2 % beyond.

A row that was broken counts again as unbroken, of the length at which the level was known as well, when its
covariances cannot be told from those.
"""

from bisect import bisect_right
from dataclasses import dataclass

import numpy as np

from patient_side.filters.innovations_filter import AXES, InnovationsFilter
from patient_side.statespace import Array

_APART = 50
_RATIO = 1.02
_SPREAD_RATIO = 1.35
_LONGEST = 6000
_LOOK_EVERY = 8
_KNOWN = 1e-14
_ALIKE = 0.03
"""Covariances are alike when no entry differs by more, in units of the deviations of row and column ..."""
_NEGLIGIBLE = 1e-3
"""... and of those that one sample's noise adds."""


@dataclass(frozen=True, eq=False)
class Unbroken:
    """Stages of an unbroken row: ``lengths`` (S,) at which they begin, covariance and gain of the sample there.

    ``covariances`` (S, M, M) are those after the sample, ``gains`` (N, 3) those that took it in, ``variances``
    (S,) what the square of its innovation is expected to be. ``stage_of`` holds the stage of each length, and
    ``spread_stage_of`` the one whose covariance forecasts are given; a longer row is in the last one.
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

    @classmethod
    def of(cls, filter_: InnovationsFilter, longest: int = _LONGEST) -> "Unbroken":
        """Run the filter's covariances over a row of ``longest`` samples. Oracle: the filter itself.

        Of a model without a level everything is known in the end; from there on rows are alike to rounding.
        """
        d, covariance = filter_.n_axes, filter_.start_covariance
        lengths, covariances, stage_of = [1], [covariance], [0, 0]
        gains, variances = [np.zeros((len(filter_.one_step), AXES))], [1.0]
        added = np.sqrt(np.diag(filter_.noises[1]))
        nothing = _KNOWN * np.outer(added, added)
        for length in range(2, longest + 1):
            weights, variance, covariance = filter_.gain(covariance, 1)
            if length <= _APART or length >= _RATIO * lengths[-1]:
                lengths.append(length)
                covariances.append(covariance)
                gains.append(weights)
                variances.append(variance)
            stage_of.append(len(lengths) - 1)
            if filter_.level is None and length % _LOOK_EVERY == 0 and np.all(np.abs(covariance) <= nothing):
                break
        # each of them stays in Fortran's order, as the filter's gain wants it
        stacked = np.array([each.T for each in covariances]).transpose(0, 2, 1)
        level = filter_.level_of_axis
        # but for the position, which is certain: there nothing but rounding differs
        known = np.sqrt(np.maximum(np.diagonal(stacked, axis1=1, axis2=2)[:, :-d], 0.0))
        alike = np.full_like(stacked, np.inf)
        alike[:, :-d, :-d] = _ALIKE * known[:, :, None] * known[:, None, :]
        alike[:, :-d, :-d] += _NEGLIGIBLE * np.outer(added, added)[:-d, :-d]
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
        )

    def stage(self, length: int) -> int:
        """Return the stage of an unbroken row of ``length`` samples."""
        return self.stage_of[length] if length < len(self.stage_of) else len(self.lengths) - 1

    def spread_stage(self, length: int) -> int:
        """Return the stage whose covariance forecasts after a row of ``length`` samples are given: a shorter row's.

        What a level adds to a forecast's covariance is told apart to a third, so that forecasts can be kept.
        """
        return self.spread_stage_of[min(length, len(self.spread_stage_of) - 1)]

    def length_like(self, covariance: Array) -> int:
        """Return the length of the unbroken row that leaves such a covariance (M, M), or 0 where none does."""
        stage = len(self.lengths) - 1
        if self._level is not None:
            # it falls with the length: negated it is sorted
            stage = bisect_right(self._level_variances, -_level_variance(covariance, self._level)) - 1
            if stage < 0:
                return 0
        own, alike = self.covariances[stage], self._alike[stage]
        if abs(covariance.item(0) - own.item(0)) > alike.item(0):  # mostly one entry tells
            return 0
        difference = np.abs(covariance - own)
        return self.lengths[stage] if np.count_nonzero(difference <= alike) == alike.size else 0


def _level_variance(covariance: Array, level: Array) -> float:
    """Return the variance of the level that ``level`` (M,) gives, of a covariance (M, M)."""
    return float(level @ covariance @ level)


def _coarse(lengths: list[int], stage_of: list[int]) -> list[int]:
    """Return for each length the stage it shares with lengths up to `_SPREAD_RATIO` times as long."""
    first, coarse = 0, []
    for stage in stage_of:
        if lengths[stage] <= _APART or lengths[stage] >= _SPREAD_RATIO * lengths[first]:
            first = stage
        coarse.append(first)
    return coarse
