"""The marginal distribution of delays: the best family, or quantiles if no family is close enough."""

from math import log, sqrt
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Floats
from tis.netem.fit.families import FAMILIES, Fitted
from tis.netem.fit.quantile_table import quantile_table

MarginalName = Literal[
    "constant", "uniform", "normal", "lognormal", "exponential", "gamma", "pareto", "hyperexponential", "quantiles"
]

_MAX_VALUES: Final = 20_000
_KS_MARGIN: Final = 0.01
_MAX_KS: Final = 0.03
_KS_POINT: Final = 1.628  # Kolmogorov's distribution at 1 %
_DIGITS: Final = 6


class Candidate(NamedTuple):
    """A fitted distribution: the stage, its Kolmogorov-Smirnov distance to the sample, and its BIC.

    ``bic`` is Schwarz's criterion, lower is better; None without a density.
    """

    name: MarginalName
    stage: dict[str, Any]
    ks: float
    bic: float | None


class Marginal(NamedTuple):
    """The result: ``stage`` is that of ``chosen``, as a scenario's ``delay``; ``candidates`` are sorted, best first.

    A family with a distance above ``ks_bound`` is not chosen; then the quantiles are.
    """

    chosen: MarginalName
    stage: dict[str, Any]
    candidates: tuple[Candidate, ...]
    ks_bound: float


def fit_marginal(delay_ns: NDArray[np.int64], n_independent: float, wanted: MarginalName | None = None) -> Marginal:
    """Return the distribution of delays, (N,), N >= 2; raises ValueError where ``wanted`` cannot be fitted.

    Families are ranked by BIC; the best one is chosen if it lies within 0.01 + 1.628 / sqrt(n_independent) of the
    sample's distribution function. For correlated delays, which count as fewer independent ones, this bound is at
    most 0.03, so that the profile stays close to the record. A constant, the median, is chosen only if ``wanted``.
    The fit uses up to 20 000 quantiles of the sample. Oracle: samples of known distributions by scipy.stats,
    tests/netem/fit/test_marginal.
    """
    ordered_ns = np.sort(delay_ns)
    n = len(ordered_ns)
    x = _thinned(ordered_ns) / NS_PER_MS
    candidates = [
        Candidate(name, _rounded(fitted.stage), _ks(fitted, x), _bic(fitted, n))  # type: ignore[arg-type]
        for name, family in FAMILIES.items()
        if (fitted := family(x)) is not None
    ]
    candidates.sort(key=lambda candidate: candidate.bic if candidate.bic is not None else np.inf)
    bound = _ks_bound(n, n_independent)
    others = [_constant(ordered_ns), _quantiles(ordered_ns)]
    chosen = next((c for c in (*candidates, *others) if c.name == wanted), None)
    if chosen is None and wanted is not None:
        raise ValueError(f"a {wanted} distribution cannot be fitted to these delays")
    if chosen is None:
        good = candidates and candidates[0].ks <= bound
        chosen = candidates[0] if good else others[1]
    return Marginal(chosen.name, chosen.stage, (*candidates, *others), bound)


def _ks_bound(n: int, n_independent: float) -> float:
    if_independent = _KS_MARGIN + _KS_POINT / sqrt(n)
    if_not = _KS_MARGIN + _KS_POINT / sqrt(max(1.0, n_independent))
    return max(if_independent, min(if_not, _MAX_KS))


def _thinned(ordered_ns: NDArray[np.int64]) -> Floats:
    n = len(ordered_ns)
    if n <= _MAX_VALUES:
        return ordered_ns.astype(np.float64)
    inner = ((np.arange(1, _MAX_VALUES - 1) + 0.5) * n / _MAX_VALUES).astype(np.int64)
    return ordered_ns[np.concatenate(([0], inner, [n - 1]))].astype(np.float64)


def _ks(fitted: Fitted, x: Floats) -> float:
    n = len(x)
    cdf = fitted.cdf(x)
    ranks = np.arange(n)
    return float(max(np.max((ranks + 1) / n - cdf), np.max(cdf - ranks / n)))


def _bic(fitted: Fitted, n: int) -> float:
    return -2 * n * fitted.mean_log_density + fitted.n_parameters * log(n)


def _constant(ordered_ns: NDArray[np.int64]) -> Candidate:
    value_ns = float(np.median(ordered_ns))  # robust: the machine adds rare, large delays, always positive
    below, upto = np.mean(ordered_ns < value_ns), np.mean(ordered_ns <= value_ns)
    stage = {"kind": "constant", "delay_ms": value_ns / NS_PER_MS}
    return Candidate("constant", _rounded(stage), float(max(below, 1 - upto)), None)


def _quantiles(ordered_ns: NDArray[np.int64]) -> Candidate:
    table = quantile_table(ordered_ns)
    points = [
        {"p": float(f"{p:.9g}"), "delay_ms": float(f"{delay / NS_PER_MS:.9g}")}
        for p, delay in zip(table.p, table.delay_ns, strict=True)
    ]
    values, upto = _steps(ordered_ns.astype(np.float64), np.linspace(0, 1, len(ordered_ns)))
    ks = float(np.max(np.abs(np.interp(values, *_steps(table.delay_ns, table.p)) - upto)))
    return Candidate("quantiles", {"kind": "quantiles", "points": points}, ks, None)


def _steps(delay_ns: Floats, p: Floats) -> tuple[Floats, Floats]:
    """Return the corners of the distribution function; at a step only the upper end, as `np.interp` needs."""
    last = np.append(delay_ns[1:] > delay_ns[:-1], True)
    return delay_ns[last], p[last]


def _rounded(stage: dict[str, Any]) -> dict[str, Any]:
    """Round a fitted stage to significant digits; weights still sum to 1."""

    def significant(value: Any) -> Any:
        return float(f"{value:.{_DIGITS}g}") if isinstance(value, float) else value

    rounded = {
        key: [significant(item) for item in value] if isinstance(value, list) else significant(value)
        for key, value in stage.items()
    }
    if "weights" in rounded:
        *others, _ = rounded["weights"]
        rounded["weights"] = [*others, round(1 - sum(others), _DIGITS + 2)]
    return rounded
