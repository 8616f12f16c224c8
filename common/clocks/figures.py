"""From the uncertainty of single durations to that of the figures which sum them up."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from common.metrics.percentiles import Summary, summarise


def uncertainties(
    values: ArrayLike,
    uncertainty: ArrayLike,
    percentiles: Sequence[float] = (50, 95, 99),
    also: Sequence[Literal["mean", "max"]] = ("max",),
) -> Summary:
    """Return how far each figure of `summarise` can be off when each of ``values`` (N,) can be by ``uncertainty``.

    Means, percentiles and maxima never fall when a value rises, so the true figure lies between that of all values
    at their lower ends and that of all at their upper ends: a bound, in the unit of the values. None where there is
    no figure. Oracle: random values within their uncertainty (tests/common/clocks/test_figures).
    """
    values, uncertainty = np.asarray(values, dtype=np.float64), np.asarray(uncertainty, dtype=np.float64)
    low, mid, high = (
        summarise(ends, percentiles, also) for ends in (values - uncertainty, values, values + uncertainty)
    )
    found: Summary = {}
    for name, value in mid.items():
        lowest, highest = low[name], high[name]
        known = value is not None and lowest is not None and highest is not None
        found[name] = max(highest - value, value - lowest) if known else None  # type: ignore[operator]
    return found


def is_resolvable(value: float | None, uncertainty: float | None) -> bool:
    """Tell whether a figure says more than nothing: its uncertainty is not above its size."""
    return value is None or uncertainty is None or uncertainty <= abs(value)
