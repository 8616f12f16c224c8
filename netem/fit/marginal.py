"""The marginal distribution of delays: the best family, or a table of few quantiles if no family is close enough."""

import heapq
from itertools import pairwise
from math import log, sqrt
from typing import Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Floats
from tis.netem.fit.families import FAMILIES, Fitted
from tis.netem.fit.record import rounded

MarginalName = Literal[
    "constant", "uniform", "normal", "lognormal", "exponential", "gamma", "pareto", "hyperexponential", "quantiles"
]

_MAX_VALUES: Final = 20_000
_KS_MARGIN: Final = 0.01
_MAX_KS: Final = 0.03
_KS_POINT: Final = 1.628  # Kolmogorov's distribution at 1 %
_DIGITS: Final = 6
_ALWAYS: Final = (0.5, 0.9, 0.99, 0.999)


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
    most 0.03, so that the profile stays close to the record. A constant, the median, is chosen only if ``wanted`` or
    where all delays are equal; then no family is a candidate.
    The fit uses up to 20 000 quantiles of the sample. Oracle: samples of known distributions by scipy.stats,
    tests/netem/fit/test_marginal.
    """
    ordered_ns = np.sort(delay_ns)
    n = len(ordered_ns)
    x = _thinned(ordered_ns) / NS_PER_MS
    is_constant = ordered_ns[0] == ordered_ns[-1]  # then a family has a deviation of rounding
    candidates = [
        Candidate(name, _rounded(fitted.stage), _ks(fitted, x), _bic(fitted, n))  # type: ignore[arg-type]
        for name, family in FAMILIES.items()
        if not is_constant and (fitted := family(x)) is not None
    ]
    candidates.sort(key=lambda candidate: candidate.bic if candidate.bic is not None else np.inf)
    bound = _ks_bound(n, n_independent)
    others = [_constant(ordered_ns)]
    if not is_constant or wanted == "quantiles":
        others.append(_quantiles(ordered_ns))
    chosen = next((c for c in (*candidates, *others) if c.name == wanted), None)
    if chosen is None and wanted is not None:
        raise ValueError(f"a {wanted} distribution cannot be fitted to these delays")
    if chosen is None:
        good = candidates and candidates[0].ks <= bound
        chosen = candidates[0] if good else others[-1]
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
    values, upto = _steps(ordered_ns.astype(np.float64), np.linspace(0, 1, len(ordered_ns)))
    ks = float(np.max(np.abs(np.interp(values, *_steps(table.delay_ns, table.p)) - upto)))
    return Candidate("quantiles", table.stage(9), ks, None)


def _steps(delay_ns: Floats, p: Floats) -> tuple[Floats, Floats]:
    """Return the corners of the distribution function; at a step only the upper end, as `np.interp` needs."""
    last = np.append(delay_ns[1:] > delay_ns[:-1], True)
    return delay_ns[last], p[last]


def _rounded(stage: dict[str, Any]) -> dict[str, Any]:
    """Round a fitted stage to significant digits; weights still sum to 1."""

    def significant(value: Any) -> Any:
        return rounded(value, _DIGITS) if isinstance(value, float) else value

    found = {
        key: [significant(item) for item in value] if isinstance(value, list) else significant(value)
        for key, value in stage.items()
    }
    if "weights" in found:
        *others, _ = found["weights"]
        found["weights"] = [*others, round(1 - sum(others), _DIGITS + 2)]
    return found


class QuantileTable(NamedTuple):
    """Points of a distribution function: shares ``p`` (K,) from 0 to 1, strictly ascending, and ``delay_ns`` (K,)."""

    p: Floats
    delay_ns: Floats

    def stage(self, digits: int) -> dict[str, Any]:
        """Return the table as a scenario's ``delay``, in ms with so many significant digits."""
        points = [
            {"p": rounded(p, digits), "delay_ms": rounded(delay_ns / NS_PER_MS, digits)}
            for p, delay_ns in zip(self.p, self.delay_ns, strict=True)
        ]
        return {"kind": "quantiles", "points": points}


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

    Notes
    -----
    The sample's quantile function joins the ordered values at p = i / (N - 1) (definition 7 of Hyndman and Fan), and
    the table interpolates linearly. Starting from the ends and from p50, p90, p99 and p99.9, the interval with the
    largest squared error is split where the deviation from the straight line is largest. Oracle: the distance
    computed on a grid, tests/netem/fit/test_quantile_table.
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
