"""Histogram of durations in bins 0.1 % wide: small and, unlike percentiles, additive over runs."""

from collections import Counter
from collections.abc import Iterable, Mapping
from math import ceil, floor, log

import numpy as np
from numpy.typing import NDArray

Histogram = dict[str, int]
"""Bin number (text, as JSON keys are) -> count; bin b holds the ns from 1.001^b to 1.001^(b + 1)."""

_WIDTH = log(1.001)


def histogram(values_ns: NDArray[np.int64]) -> Histogram:
    """Count durations (N,) in ns; those below 1 ns count as 1 ns."""
    bins = Counter(floor(log(max(value, 1)) / _WIDTH) for value in values_ns.tolist())
    return {str(number): bins[number] for number in sorted(bins)}


def merged(histograms: Iterable[Mapping[str, int]]) -> Histogram:
    """Return the sum of the histograms."""
    total: Counter[str] = Counter()
    for one in histograms:
        total.update(one)
    return dict(total)


def percentile_ns(counts: Mapping[str, int], percent: int) -> float | None:
    """Return the nearest-rank percentile within 0.05 %, None without values. Oracle: `common.metrics.percentiles`."""
    n = sum(counts.values())
    rank = max(ceil(percent * n / 100), 1)
    seen = 0
    for number in sorted(map(int, counts)):
        seen += counts[str(number)]
        if seen >= rank:
            return float(np.exp((number + 0.5) * _WIDTH))  # the geometric middle of the bin
    return None
