"""Figures of one person, pooled over its twins: from the cells' sums, or from the twins' summaries."""

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from math import nan, sqrt
from typing import Any, Final

from tis.common.errors import Fault
from tis.common.units import NS_PER_MS
from tis.deploy.compare.cells.sums import merged, percentile
from tis.deploy.compare.results.pooled import Scores, Sums, scores_of, sums_of
from tis.deploy.studies.admissible.criterion import COMMAND, Limit

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
