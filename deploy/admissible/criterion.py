"""The criterion of an admissible network: a limit holds with 95 % confidence over persons.

Each person has one figure, pooled over the twins of all of its trials and seeds. The population is that of persons,
so the bound is of the mean over persons: for a root mean square of the mean of squares, so that it bounds the RMSE
over the whole population.

Persons are few and their mean squares skewed. Student's upper bound is then too low, since a sample without the large
persons has a small mean and a small spread together. The skewness of the sample corrects it: Johnson, "Modified t
tests and confidence intervals for asymmetrical populations" (1978), J. Am. Stat. Assoc. 73:536. The correction is
linear in the skewness. Hall's transformation (1992) holds more often, but with four persons it was observed to jump
from 1.0 to 1.6 times Student's bound between networks with nearly equal figures. Oracle: coverage of drawn samples
of eight, test_criterion.
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
        Johnson's bound, or Student's where the sample is not skewed to the right, in the same unit.

    Notes
    -----
    With the skewness g and Student's quantile t of N - 1 degrees of freedom it is
    ``mean + s / sqrt(N) (t + g (1 + 2 t**2) / (6 sqrt(N)))``.
    """
    n, mean = len(values), float(values.mean())
    error = float(values.std(ddof=1)) / sqrt(n)
    quantile = float(stdtrit(n - 1, LEVEL))
    return mean + error * (quantile + max(0.0, _skewness(values)) * (1 + 2 * quantile**2) / (6 * sqrt(n)))


def _skewness(values: Array) -> float:
    """Return the sample's skewness, corrected for its size; 0 for two values or equal ones."""
    n, central = len(values), values - values.mean()
    variance = float((central**2).mean())
    if n < _MIN_FOR_SKEWNESS or variance == 0.0:
        return 0.0
    third = float((central**3).mean())
    return third / float(variance**1.5) * sqrt(n * (n - 1)) / (n - 2)


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
