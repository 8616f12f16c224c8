"""The criterion of an admissible network: a limit holds with 95 % confidence over persons.

Each person has one figure, pooled over the twins of all of its trials and seeds. The population is that of persons,
so the bound is of the mean over persons: for a root mean square of the mean of squares, so that it bounds the RMSE
over the whole population.

Persons are few and their mean squares skewed. Student's upper bound is then too low, since a sample without the large
persons has a small mean and a small spread together. The skewness of the sample corrects it: Hall, "On the removal of
skewness by transformation" (1992), J. R. Stat. Soc. B 54:221. Of both bounds the larger counts. Oracle: coverage of
drawn samples of eight, test_criterion.
"""

from collections.abc import Sequence
from math import sqrt

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from deploy.admissible.limits import Limit

LEVEL = 0.95
MIN_PERSONS = 2
_MIN_FOR_SKEWNESS = 3

Array = NDArray[np.float64]


def upper_bound(values: Array) -> float:
    """Return the one-sided 95 % upper confidence bound of a population's mean.

    Parameters
    ----------
    values : Array
        Figures of persons drawn from it, (N,), N >= 2, in any unit.

    Returns
    -------
    float
        The larger one of Student's bound and Hall's, in the same unit; the value itself where all are equal.

    Notes
    -----
    With skewness g, ``a = g / sqrt(N)`` and Student's quantile t, Hall's bound is
    ``mean - 3 / a (cbrt(1 - a (t + a / 6)) - 1) s / sqrt(N)``.
    """
    n, mean = len(values), float(values.mean())
    error = float(values.std(ddof=1)) / sqrt(n)
    if error == 0.0:
        return mean
    quantile = float(stdtrit(n - 1, LEVEL))
    student = mean + quantile * error
    if n < _MIN_FOR_SKEWNESS:
        return student
    central = values - mean
    skewness = float((central**3).mean()) / float((central**2).mean()) ** 1.5 * sqrt(n * (n - 1)) / (n - 2)
    a = skewness / sqrt(n)
    if abs(a) < 1e-6:
        return student
    hall = mean - 3 / a * (float(np.cbrt(1 - a * (quantile + a / 6))) - 1) * error
    return float(max(student, hall))


def bound_of(limit: Limit, figures: Sequence[float]) -> float:
    """Return the bound that a limit is compared with, from the persons' figures; NaN if one of them is unknown.

    An upper bound for a limit that is the largest value allowed, else a lower one.
    """
    values = np.array(figures, dtype=np.float64)
    if not np.isfinite(values).all():
        return float("nan")
    if limit.is_root_mean_square and limit.at_most:
        return sqrt(upper_bound(values**2))
    return upper_bound(values) if limit.at_most else -upper_bound(-values)


def worst_margin(limits: Sequence[Limit], figures: Sequence[Sequence[float]]) -> float:
    """Return the largest margin of several limits, which must hold together; ``figures`` are those of each limit."""
    return max(limit.margin(bound_of(limit, each)) for limit, each in zip(limits, figures, strict=True))
