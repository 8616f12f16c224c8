"""Model selection for the regressions of `direct_ls`: the most cautious candidate that cross-validation supports.

The smallest of many errors is partly chance, the more so the fewer movements the rows hold. The standard-error rule
(Breiman, Friedman, Olshen and Stone, *Classification and Regression Trees*, 1984, 3.4.3) selects the most cautious
candidate whose error is hardly above the smallest: here within half a standard error, as each horizon's errors are
averaged with those up to an octave away, which removes most of the chance. The most cautious candidate forecasts the
smallest moves: with few rows it approaches hold, with many rows the caution vanishes.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from patient_side.identification.second_moments import RESOLUTION, Moments, pooled
from patient_side.statespace import Array

_OCTAVES = 1.0
_STANDARD_ERRORS = 0.5


@dataclass(frozen=True)
class Candidate:
    """Number of lags and penalty of a regression."""

    n_lags: int
    penalty: float


def most_cautious(
    parts: Sequence[Moments], walk: Array, candidates: Sequence[Candidate], steps: NDArray[np.int64]
) -> list[Candidate]:
    """Return the selected candidate at each horizon of ``steps`` (H,) samples; at least two ``parts`` must have rows.

    The parts are runs of rows, not rows drawn at random, as neighbouring rows share most of their movement; each is
    left out in turn, together with as many of its neighbours as the horizon reaches into (h-block cross-validation:
    Burman, Chow and Nolan, 1994). The standard error is that of the mean over the parts, for the difference to the
    best candidate, as a difficult part is difficult for all candidates. Oracles: rows left out one part after
    another, and a random walk.
    """
    # For each width of the gap, the moments of all rows outside it.
    parts = [part for part in parts if part.n_rows]
    whole, places = pooled(parts), np.arange(len(parts))
    gaps = np.minimum(np.rint(steps * len(parts) / whole.n_rows).astype(int), len(parts) // 2 - 1)
    others = {
        gap: [pooled([parts[i] for i in np.flatnonzero(np.abs(places - place) > gap)]) for place in places]
        for gap in set(gaps.tolist())
    }
    # Errors on the parts left out, and sizes of the forecast moves on all rows.
    errors, moved = np.empty((len(candidates), len(parts), len(steps))), np.empty((len(candidates), len(steps)))
    for c, candidate in enumerate(candidates):
        fit = walk, candidate.penalty, whole.axes * candidate.n_lags
        moved[c] = whole.squares_moved(whole.weights(*fit))
        for gap, fitted in others.items():
            for place, (part, other) in enumerate(zip(parts, fitted, strict=True)):
                errors[c, place, gaps == gap] = part.squares_left(other.weights(*fit))[gaps == gap]
    # In units of the error of hold, averaged over horizons up to an octave away.
    held = np.trace(whole.future, axis1=1, axis2=2) + whole.axes * RESOLUTION**2
    near = (np.abs(np.log2(steps[:, None] / steps)) <= _OCTAVES).astype(float)
    averaged = errors / held @ (near / near.sum(axis=0))
    return [candidates[i] for i in _least_moved_of_the_best(averaged, moved)]


def _least_moved_of_the_best(errors: Array, moved: Array) -> list[int]:
    """Return for each horizon the candidate that moves least (candidates, H) among those as good as the best."""
    best = errors.mean(axis=1).argmin(axis=0)
    worse = errors - np.take_along_axis(errors, best[None, None], axis=0)
    standard_errors = worse.std(axis=1, ddof=1) / np.sqrt(errors.shape[1])
    as_good = worse.mean(axis=1) <= _STANDARD_ERRORS * standard_errors
    return [int(i) for i in np.where(as_good, moved, np.inf).argmin(axis=0)]
