"""Uncertainty of summary statistics, from that of the single durations."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from tis.common.metrics.percentiles import Summary, summarise


def uncertainties(
    values: ArrayLike,
    uncertainty: ArrayLike,
    percentiles: Sequence[float] = (50, 95, 99),
    also: Sequence[Literal["mean", "max"]] = ("max",),
) -> Summary:
    """Return a bound on the error of each figure of `summarise`, when ``values`` (N,) are off by ``uncertainty``.

    Means, percentiles and maxima are monotonic in each value, so the true figure lies between that of all lower ends
    and that of all upper ends. In the unit of the values; None where there is no figure. Oracle: random values
    within their uncertainty, test_uncertainty.
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
