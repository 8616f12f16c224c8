"""Order statistics of a sample, for every table of the summary."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike

Statistic = Literal["mean", "std", "max"]
Summary = dict[str, float | None]

TAIL: Final = (50, 90, 95, 99, 99.9)
"""Percentiles of quantities with an important tail, like delays."""


def summarise(
    values: ArrayLike, percentiles: Sequence[float] = (50, 95, 99), also: Sequence[Statistic] = ("max",)
) -> Summary:
    """Return the requested ones of mean, std, percentiles and maximum of ``values``, in that order.

    A percentile is the smallest measured value at or below which at least that share of the values lies (RFC 2330,
    section 11.3; the nearest-rank definition, number 1 of Hyndman and Fan). It is not interpolated, so with fewer
    than 100 values p99 is the maximum. ``std`` is divided by n. Names are like ``p50`` and ``p99.9``.

    ``values`` is one-dimensional and finite, else `ValueError`; without values every entry is None (null in JSON).
    Oracle: the empirical distribution function counted in exact fractions.
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64))
    n = len(ordered)
    if not np.isfinite(ordered).all():
        raise ValueError("only finite values have percentiles")

    result: Summary = {}
    if "mean" in also:
        result["mean"] = float(ordered.mean()) if n else None
    if "std" in also:
        result["std"] = float(ordered.std()) if n else None
    for p in percentiles:
        share = Fraction(str(p)) / 100  # exact: in floats 0.07 * 100 is above 7
        rank = max(-(-share.numerator * n // share.denominator), 1)
        result[f"p{p:g}"] = float(ordered[rank - 1]) if n else None
    if "max" in also:
        result["max"] = float(ordered[-1]) if n else None
    return result
