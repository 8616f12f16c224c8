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
from scipy.linalg.lapack import dposv

from patient_side.innovations_filter import AXES, InnovationsFilter
from patient_side.statespace import Array

_APART = 50
_RATIO = 1.02
_SPREAD_RATIO = 1.35
_LONGEST = 6000
_ALIKE = 0.03
"""Covariances are alike when no entry differs by more, in units of the deviations of row and column ..."""
_NEGLIGIBLE = 1e-3
"""... and of those that one sample's noise adds."""


@dataclass(frozen=True, eq=False)
class Unbroken:
    """Stages of an unbroken row: ``lengths`` (S,) at which they begin, covariance and gain of the sample there.

    ``covariances`` (S, N, N) are those after the sample, ``gains`` (N, 3) those that took it in, ``variances``
    (S,) what the square of its innovation is expected to be. ``stage_of`` holds the stage of each length, and
    ``spread_stage_of`` the one whose covariance forecasts are given; a longer row is in the last one.
    """

    lengths: tuple[int, ...]
    covariances: Array
    gains: tuple[Array, ...]
    variances: tuple[float, ...]
    stage_of: tuple[int, ...]
    spread_stage_of: tuple[int, ...]
    _level: slice | None
    _level_variances: tuple[float, ...]
    _alike: Array

    @classmethod
    def of(cls, filter_: InnovationsFilter, longest: int = _LONGEST) -> "Unbroken":
        """Run the filter's covariances over a row of ``longest`` samples. Oracle: the filter itself."""
        step, noise = filter_.one_step, filter_.noises[1]
        covariance, gain = filter_.start_covariance, np.zeros((len(step), AXES))
        lengths, covariances, gains, variances, stage_of = [1], [covariance], [gain], [1.0], [0, 0]
        for length in range(2, longest + 1):
            covariance = step.dot(covariance).dot(step.T)
            covariance += noise
            rows = covariance[-AXES:]
            expected = rows[:, -AXES:]
            _, weights, _ = dposv(expected, rows)
            if length <= _APART or length >= _RATIO * lengths[-1]:
                variances.append(float(expected.trace()))
                gains.append(np.ascontiguousarray(weights.T))
                lengths.append(length)
            covariance = covariance - rows.T.dot(weights)
            covariance = 0.5 * (covariance + covariance.T)
            if lengths[-1] == length:
                covariances.append(covariance)
            stage_of.append(len(lengths) - 1)
        level, stacked = filter_.level, np.array(covariances)
        first = 0 if level is None else level.start
        # but for the position, which is certain: there nothing but rounding differs
        known = np.sqrt(np.maximum(np.diagonal(stacked, axis1=1, axis2=2)[:, :-AXES], 0.0))
        added = np.sqrt(np.diag(noise)[:-AXES])
        return cls(
            tuple(lengths),
            stacked,
            tuple(gains),
            tuple(variances),
            tuple(stage_of),
            tuple(_coarse(lengths, stage_of)),
            level,
            tuple((-stacked[:, first, first]).tolist()),
            _ALIKE * known[:, :, None] * known[:, None, :] + _NEGLIGIBLE * np.outer(added, added),
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
        """Return the length of the unbroken row that leaves such a covariance (N, N), or 0 where none does."""
        stage = len(self.lengths) - 1
        if self._level is not None:
            at = self._level.start
            variance = -float(covariance[at, at])  # it falls with the length: negated it is sorted
            stage = bisect_right(self._level_variances, variance) - 1
            if stage < 0:
                return 0
        difference = np.abs(covariance - self.covariances[stage])[:-AXES, :-AXES]
        alike = bool((difference <= self._alike[stage]).all())
        return self.lengths[stage] if alike else 0


def _coarse(lengths: list[int], stage_of: list[int]) -> list[int]:
    """Return for each length the stage it shares with lengths up to `_SPREAD_RATIO` times as long."""
    first, coarse = 0, []
    for stage in stage_of:
        if lengths[stage] <= _APART or lengths[stage] >= _SPREAD_RATIO * lengths[first]:
            first = stage
        coarse.append(first)
    return coarse
