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

import difflib
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import hypot, isfinite, log, nan, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from tis.common.errors import Fault, InputError
from tis.common.units import NS_PER_MS
from tis.deploy.compare.cells.sums import merged, percentile
from tis.deploy.compare.results.pooled import Scores, Sums, scores_of, sums_of

# Limits on figures: ``NAME<=V``, ``NAME>=V``, or ``NAME=V`` in the figure's natural direction.

COMMAND: Final = "tis admissible"
_LIMIT: Final = re.compile(r"(?P<name>[A-Za-z][^<>=\s]*)\s*(?P<relation><=|>=|=)\s*(?P<value>\S+)")
_RMSE: Final = re.compile(r"(?<![a-z])rmse")  # and not nrmse_fit, which may be negative
_LARGER_IS_BETTER: Final = (
    "coverage",
    "r2_",
    "nrmse_fit",
    "valid",
    "faithful",
    "consistent",
    "stable",
    "decodable",
    "pictures",
)
_OF_SCENARIOS: Final = {"hand_to_eye_p99_ms": "sight.hand_to_eye_ms.p99", "freeze_max_pct": "sight.freeze_pct"}
"""Limits of a scenario that may be named as there."""
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
    return Limit(_OF_SCENARIOS.get(found["name"], found["name"]), at_most, value)


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


def figure_of(limit: Limit, figures: Sequence[float]) -> float:
    """Return the figure of all persons, whose bound is `bound_of`: their mean, of squares for a largest RMSE."""
    values = np.array(figures, dtype=np.float64)
    is_squared = limit.is_root_mean_square and limit.at_most
    return sqrt(float((values**2).mean())) if is_squared else float(values.mean())


def _bound(values: Array, drawn: Array) -> float:
    mean = float(values.mean())
    return mean + hypot(upper_bound(values) - mean, seed_error(drawn))


# Figures of one person, pooled over its twins: from the cells' sums, or from the twins' summaries.

Hands = Sequence[Mapping[str, Any]]
ESTIMATOR: Final = "ESTIMATOR"
"""Part of a summary's key that stands for each estimator in turn."""

_AXES: Final = "xyz"
_N_NEAR: Final = 3


def _score(name: str, axis: int | None = None) -> Callable[[Hands, str], float]:
    def found(hands: Hands, estimator: str) -> float:
        scores: Scores = scores_of(sums_of(hands, estimator))
        value = getattr(scores, name)
        return float(value if axis is None else value[axis])

    return found


def _missing_pct(hands: Hands, estimator: str) -> float:
    sums: Sums = sums_of(hands, estimator)
    return 100 * float(sums.n_missing) / float(sums.n)


def _age_mean_ms(hands: Hands, _: str) -> float:
    return float(sum(hand["age_sum_ns"] for hand in hands) / NS_PER_MS / sum(hand["n_scored"] for hand in hands))


def _age_percentile(percent: int) -> Callable[[Hands, str], float]:
    def found(hands: Hands, _: str) -> float:
        value_ns = percentile(merged(hand["age_ns"] for hand in hands), percent)
        return nan if value_ns is None else value_ns / NS_PER_MS

    return found


OF_CELLS: Final[Mapping[str, Callable[[Hands, str], float]]] = {
    "rmse_3d_mm": _score("rmse_3d_mm"),
    **{f"rmse_mm_{axis}": _score("rmse_mm", i) for i, axis in enumerate(_AXES)},
    **{f"r2_pct_{axis}": _score("r2_pct", i) for i, axis in enumerate(_AXES)},
    "ratio_to_hold": _score("ratio_to_hold"),
    "coverage_pct": _score("coverage_pct"),
    "missing_pct": _missing_pct,
    "age_mean_ms": _age_mean_ms,
    "age_p50_ms": _age_percentile(50),
    "age_p99_ms": _age_percentile(99),
}
"""Figures that follow from a cell's sums, by name; every other name is a key of the summary."""


def of_cells(name: str, results: Sequence[Mapping[str, Any]], estimator: str) -> float:
    """Return a person's figure from the results of its cells; NaN if one of them has no scored tick."""
    if any(result["unscored"] is not None for result in results):
        return nan
    return OF_CELLS[name]([hand for result in results for hand in result["hands"].values()], estimator)


def of_summaries(limit: Limit, summaries: Sequence[Mapping[str, float | None]], estimator: str) -> float:
    """Return a person's figure from flat summaries: the mean, of squares for an RMSE; NaN if one of them lacks it."""
    values = [summary.get(limit.name.replace(ESTIMATOR, estimator)) for summary in summaries]
    known = [value for value in values if value is not None]
    if len(known) < len(values):
        return nan
    if limit.is_root_mean_square:
        return sqrt(sum(value * value for value in known) / len(known))
    return sum(known) / len(known)


def name_faults(limits: Sequence[Limit], keys: Iterable[str], estimators: Sequence[str]) -> list[Fault]:
    """Return a fault for each limit whose name is no figure of cells, and none of these keys of a summary."""
    known = dict.fromkeys([*OF_CELLS, *(_general(key, estimators) for key in keys), *keys])
    faults = []
    for limit in limits:
        if limit.name in known:
            continue
        near = difflib.get_close_matches(limit.name, known, _N_NEAR, cutoff=0.4)
        near += [key for key in known if key.endswith(f".{limit.name}") and key not in near][:_N_NEAR]
        hint = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(OF_CELLS)}"
        rule = f"must be one of the fast figures or a key of summary.json; {hint}"
        faults.append(Fault(COMMAND, "--limit", rule, limit.name))
    return faults


def _general(key: str, estimators: Sequence[str]) -> str:
    """Return a key with its estimator's name replaced by the word for all."""
    return ".".join(ESTIMATOR if step in estimators else step for step in key.split("."))
