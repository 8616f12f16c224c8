"""The criterion of an admissible network: a limit holds with 95 % confidence over persons and seeds.

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

import re
from collections.abc import Sequence
from math import hypot, isfinite, log, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tis.common.errors import Fault, InputError

# Limits on figures: ``NAME<=V``, ``NAME>=V``, or ``NAME=V`` in the figure's natural direction.

COMMAND: Final = "tis admissible"
_LIMIT: Final = re.compile(r"(?P<name>[A-Za-z][^<>=\s]*)\s*(?P<relation><=|>=|=)\s*(?P<value>\S+)")
_RMSE: Final = re.compile(r"(?<![a-z])rmse")  # and not nrmse_fit, which may be negative
_LARGER_IS_BETTER: Final = ("coverage", "r2_", "nrmse_fit", "valid", "faithful", "consistent")
_LARGEST_MARGIN: Final = 20.0


class Limit(NamedTuple):
    """Largest value of a figure, or its smallest one unless ``at_most``."""

    name: str
    at_most: bool
    value: float

    @property
    def is_root_mean_square(self) -> bool:
        """True for a figure that is pooled over twins and persons by its square."""
        return _RMSE.search(self.name) is not None

    @property
    def text(self) -> str:
        """The limit as the command line takes it."""
        return f"{self.name}{'<=' if self.at_most else '>='}{self.value:g}"

    def margin(self, bound: float) -> float:
        """Return how far a bound is beyond the limit: 0 at it, negative within it, infinite if unknown.

        ``log(bound / limit)`` where both are positive, else the difference over the limit, or over 1 below 1.
        """
        if not isfinite(bound):
            return float("inf")
        if self.value > 0 and bound > 0:
            beyond = log(bound / self.value)
        else:
            beyond = (bound - self.value) / max(1.0, abs(self.value))
        beyond = beyond if self.at_most else -beyond
        return min(_LARGEST_MARGIN, max(-_LARGEST_MARGIN, beyond))


def parse_limit(text: str) -> Limit:
    """Return a limit; raises `InputError`."""
    found = _LIMIT.fullmatch(text.strip())
    if found is None:
        raise InputError(Fault(COMMAND, "--limit", "must read NAME=VALUE, NAME<=VALUE or NAME>=VALUE", text))
    try:
        value = float(found["value"])
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InputError(Fault(COMMAND, "--limit", "must be a number", text))
    at_most = found["relation"] == "<="
    if found["relation"] == "=":
        at_most = not any(word in found["name"] for word in _LARGER_IS_BETTER)
    return Limit(found["name"], at_most, value)


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


def seed_error(values: Array) -> float:
    """Return how far a mean over seeds may be too low, at 95 % confidence: Student's margin, 0 for fewer than two.

    ``values`` (S,) are figures of all persons together. All persons meet the same draws of the network, so their
    spread does not show what other draws would change.
    """
    n = len(values)
    return float(stdtrit(n - 1, LEVEL)) * float(values.std(ddof=1)) / sqrt(n) if n > 1 else 0.0


def bound_of(limit: Limit, figures: Sequence[float], of_seeds: Sequence[float] = ()) -> float:
    """Return the bound that a limit is compared with; NaN if a figure is unknown.

    Parameters
    ----------
    limit : Limit
        The limit; one that is the largest value allowed has an upper bound, the others a lower one.
    figures : Sequence[float]
        The figure of each person, over all seeds.
    of_seeds : Sequence[float]
        The figure of each seed, over all persons; empty where each seed is a person.

    Notes
    -----
    The two errors, of the choice of persons and of seeds, are independent: their margins add in quadrature.
    """
    values, drawn = np.array(figures, dtype=np.float64), np.array(of_seeds, dtype=np.float64)
    if not (np.isfinite(values).all() and np.isfinite(drawn).all()):
        return float("nan")
    if limit.is_root_mean_square and limit.at_most:
        return sqrt(_bound(values**2, drawn**2))
    return _bound(values, drawn) if limit.at_most else -_bound(-values, -drawn)


def _bound(values: Array, drawn: Array) -> float:
    mean = float(values.mean())
    return mean + hypot(upper_bound(values) - mean, seed_error(drawn))
