"""A distribution as a table of few quantiles with linear interpolation, to a given accuracy."""

import heapq
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.netem.draws.blocks import Floats

_ALWAYS: Final = (0.5, 0.9, 0.99, 0.999)


class QuantileTable(NamedTuple):
    """Points of a distribution function: shares ``p`` (K,) from 0 to 1, strictly ascending, and ``delay_ns`` (K,)."""

    p: Floats
    delay_ns: Floats


def quantile_table(delay_ns: NDArray[np.int64], tolerance: float = 0.005, most: int = 200) -> QuantileTable:
    """Return a small table of quantiles, found by a greedy search, within a distance of the sample.

    Parameters
    ----------
    delay_ns
        (N,) delays, N >= 2, in any order.
    tolerance
        Bound on the distance between the sample and the table as distributions, in standard deviations of the
        sample: the 2-Wasserstein distance, the root mean square difference of the quantile functions. Mean and
        standard deviation differ by no more than that.
    most
        Maximum number of points; the distance may then be larger.

    Notes ----- The sample's quantile function joins the ordered values at p = i / (N - 1) (definition 7 of Hyndman
    and Fan). Starting from the ends and from p50, p90, p99 and p99.9, the interval with the largest squared error is
    split where the deviation from the straight line is largest. Oracle: the distance computed on a grid,
    tests/netem/fit/test_quantile_table.
    """
    ordered = np.sort(delay_ns).astype(np.float64)
    last = len(ordered) - 1
    knots = sorted({0, last, *(round(p * last) for p in _ALWAYS)})
    stretches = [(*_worst(ordered, low, high), low, high) for low, high in pairwise(knots)]
    heapq.heapify(stretches)
    missed = -sum(stretch[0] for stretch in stretches)
    allowed = (tolerance * float(ordered.std())) ** 2 * len(ordered)
    while missed > allowed and len(knots) < most:
        error, split, low, high = heapq.heappop(stretches)
        if error == 0:
            break
        missed += error
        knots.append(split)
        for left, right in ((low, split), (split, high)):
            part = (*_worst(ordered, left, right), left, right)
            missed -= part[0]
            heapq.heappush(stretches, part)
    places = np.array(sorted(knots))
    return QuantileTable(places / last, ordered[places])


def _worst(ordered: Floats, low: int, high: int) -> tuple[float, int]:
    """Return minus the squared error of the line from ``low`` to ``high``, and the place of the largest deviation."""
    values = ordered[low : high + 1]
    off = values - np.linspace(values[0], values[-1], len(values))
    return -float(off @ off), low + int(np.abs(off).argmax())
