"""Order statistics of a sample, for every table of the summary; their uncertainty, and those of a depth over time."""

from collections.abc import Sequence
from fractions import Fraction
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

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


def median(values: ArrayLike) -> float:
    """Return the ``p50`` of `summarise`: the lower of two in the middle; raises `ValueError`.

    Oracle: `statistics.median_low`, test_percentiles.
    """
    ordered = np.sort(np.asarray(values, dtype=np.float64), axis=None)
    if not len(ordered):
        raise ValueError("no values have no median")
    return float(ordered[(len(ordered) - 1) // 2])


def uncertainties(
    values: ArrayLike,
    uncertainty: ArrayLike,
    percentiles: Sequence[float] = (50, 95, 99),
    also: Sequence[Literal["mean", "max"]] = ("max",),
) -> Summary:
    """Return a bound on the error of each figure of `summarise`, when ``values`` (N,) are off by ``uncertainty``.

    Means, percentiles and maxima are monotonic in each value, so the true figure lies between that of all lower ends
    and that of all upper ends. In the unit of the values; None where there is no figure. Oracle: random values
    within their uncertainty, test_percentiles.
    """
    values, uncertainty = np.asarray(values, dtype=np.float64), np.asarray(uncertainty, dtype=np.float64)
    low, mid, high = (
        summarise(ends, percentiles, also) for ends in (values - uncertainty, values, values + uncertainty)
    )
    found: Summary = {}
    for name, value in mid.items():
        # The interval need not be symmetric about the figure; its larger side is the bound.
        lowest, highest = low[name], high[name]
        known = value is not None and lowest is not None and highest is not None
        found[name] = max(highest - value, value - lowest) if known else None  # type: ignore[operator]
    return found


def is_resolvable(value: float | None, uncertainty: float | None) -> bool:
    """Tell whether the uncertainty of a figure is at most its magnitude, so that the figure is informative."""
    return value is None or uncertainty is None or uncertainty <= abs(value)


Instants = NDArray[np.int64]


def queue_depth(
    at_ns: Instants, depth: NDArray[np.int64], until_ns: int, percentiles: Sequence[int] = (50, 95, 99)
) -> Summary:
    """Return mean and percentiles of a depth over time, and its maximum; all None without samples.

    ``depth`` (N,), in packets or bytes, sampled at ``at_ns`` (N,), ascending, holds until the next sample, the last
    one until ``until_ns``. A percentile is the smallest depth that was not exceeded for at least that share of the
    time, without interpolation. The maximum is that of all samples; mean and percentiles are None where no time
    passed. Raises `ValueError` for instants that descend or that lie beyond ``until_ns``. Oracle: the depth at each
    nanosecond, written out, tests/common/metrics/test_percentiles.
    """
    # Each depth has the weight of the time for which it holds.
    held_ns = np.diff(at_ns, append=until_ns)
    if (held_ns < 0).any() and len(at_ns):
        raise ValueError("samples must ascend in time, and none may lie beyond until_ns")
    total_ns = int(held_ns.sum()) if len(at_ns) else 0
    result: Summary = dict.fromkeys(("mean", *(f"p{p}" for p in percentiles)))
    if total_ns:
        order = np.argsort(depth, kind="stable")
        ordered, up_to_ns = depth[order], np.cumsum(held_ns[order])
        result["mean"] = float(np.average(depth, weights=held_ns))
        for p in percentiles:
            share_ns = max(-(-p * total_ns // 100), 1)  # ceil(p total / 100) in integers, as in `summarise`
            result[f"p{p}"] = float(ordered[np.searchsorted(up_to_ns, share_ns)])
    result["max"] = float(depth.max()) if len(at_ns) else None
    return result
