"""Exponent of a cost: the slope of a straight line through its logarithms, with a confidence interval."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np


class PowerLaw(NamedTuple):
    """A cost that grows as ``size ** exponent``; ``low`` and ``high`` are the 95 % confidence interval.

    The interval is None where two sizes, or one, leave no residual to tell it from.
    """

    exponent: float
    low: float | None
    high: float | None
    n: int


def fit_power_law(sizes: Sequence[float], costs: Sequence[float]) -> PowerLaw | None:
    """Return the exponent of ``costs`` against ``sizes``, both (N,) and positive; None with fewer than two sizes.

    Least squares on the logarithms; the interval is Student's with N - 2 degrees of freedom (Draper and Smith,
    "Applied Regression Analysis", 1.4), for errors that are independent, of equal ratio and normal. A cost with a
    constant part has a smaller exponent than its growing part. Oracle: known exponents, and the interval's coverage
    over drawn errors, test_power_law.
    """
    from scipy.stats import t as student  # late: it takes long to load

    x, y = np.log(np.asarray(sizes, dtype=float)), np.log(np.asarray(costs, dtype=float))
    spread = float(np.sum((x - x.mean()) ** 2)) if len(x) else 0.0
    if spread == 0.0:
        return None
    exponent = float(np.sum((x - x.mean()) * (y - y.mean())) / spread)
    freedom = len(x) - 2
    if freedom < 1 or len(set(sizes)) < 3:
        return PowerLaw(exponent, None, None, len(x))
    residual = y - y.mean() - exponent * (x - x.mean())
    margin = float(student.ppf(0.975, freedom)) * float(np.sqrt(np.sum(residual**2) / freedom / spread))
    return PowerLaw(exponent, exponent - margin, exponent + margin, len(x))
