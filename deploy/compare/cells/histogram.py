"""Histograms in bins of equal ratio: small and, unlike percentiles, additive over runs."""

from collections import Counter
from collections.abc import Iterable, Mapping
from math import ceil, floor, log

import numpy as np
from numpy.typing import NDArray

Histogram = dict[str, int]
"""Bin number (text, as JSON keys are) -> count; bin b holds the values from 1.001^b to 1.001^(b + 1)."""

_WIDTH = log(1.001)
ERROR_WIDTH = log(1.01)
"""Width of the bins of errors, 1 %: there are three times as many values as of a step's time."""


def histogram(values: NDArray[np.int64], width: float = _WIDTH) -> Histogram:
    """Count values (N,), durations in ns or errors in nm; those below 1 count as 1. ``width``: a bin's, in logs."""
    bins = Counter(floor(log(max(value, 1)) / width) for value in values.tolist())
    return {str(number): bins[number] for number in sorted(bins)}


def merged(histograms: Iterable[Mapping[str, int]]) -> Histogram:
    """Return the sum of the histograms."""
    total: Counter[str] = Counter()
    for one in histograms:
        total.update(one)
    return dict(total)


def percentile(counts: Mapping[str, int], percent: int, width: float = _WIDTH) -> float | None:
    """Return the nearest-rank percentile within half a bin (0.05 %, of errors 0.5 %), None without values.

    100 is the largest value. Oracle: `tis.common.metrics.percentiles`.
    """
    n = sum(counts.values())
    rank = max(ceil(percent * n / 100), 1)
    seen = 0
    for number in sorted(map(int, counts)):
        seen += counts[str(number)]
        if seen >= rank:
            return float(np.exp((number + 0.5) * width))  # the geometric middle of the bin
    return None
