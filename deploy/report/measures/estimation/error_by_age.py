"""How the error grows with the age of the newest sample, from the ticks of a run."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MOST_BINS = 14
LEAST_TICKS = 10
_STEP_MS = 0.5


class ErrorByAge(NamedTuple):
    """Bins of age, ascending: the mean age (B,) in ms, the RMSE (B,) in the error's unit, and how many ticks (B,)."""

    age_ms: Array
    rmse: Array
    n: NDArray[np.int64]


def error_by_age(age_ms: Array, error: Array) -> ErrorByAge:
    """Return the root of the mean squared error of ticks of like age; ``age_ms`` and ``error`` are (T,), NaN unknown.

    Sample and tick have one rate as a rule, so ages take few values: those are the bins, rare ones put together with
    older neighbours until there are `LEAST_TICKS` ticks. Where that makes more than `MOST_BINS`, bins hold equally
    many ticks. A rest that is too small is left out. Oracle: tables worked by hand, test_error_by_age.
    """
    known = np.isfinite(age_ms) & np.isfinite(error)
    age, squared = age_ms[known], error[known] ** 2
    label = np.round(age / _STEP_MS).astype(np.int64)
    _, place, n = np.unique(label, return_inverse=True, return_counts=True)
    place = _together(n)[place]
    if len(place) and place.max() >= MOST_BINS + int(np.bincount(place)[-1] < LEAST_TICKS):
        edges = np.unique(np.quantile(age, np.linspace(0, 1, MOST_BINS + 1)))
        place = np.clip(np.searchsorted(edges, age, side="right") - 1, 0, max(len(edges) - 2, 0))
    n = np.bincount(place)
    total, ages = np.bincount(place, weights=squared), np.bincount(place, weights=age)
    enough = n >= LEAST_TICKS
    n, total, ages = n[enough], total[enough], ages[enough]
    return ErrorByAge(ages / n, np.sqrt(total / n), n)


def _together(n: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the bin of each of V ages, ascending, that occur ``n`` (V,) times; a bin is full once it has enough."""
    bins = np.zeros(len(n), dtype=np.int64)
    here = held = 0
    for i, count in enumerate(n.tolist()):
        bins[i] = here
        held += count
        if held >= LEAST_TICKS:
            here, held = here + 1, 0
    return bins
