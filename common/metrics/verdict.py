"""Verdicts on requirements: met, missed, or not decidable from the run.

Every requirement is an upper limit. A limit on a percentile allows a share of values beyond it, a limit on loss a
share of lost packets, so both are decided by Clopper and Pearson's bounds of a share (1934): met when even the upper
bound is allowed, missed when the lower bound is not. If nothing lies beyond the limit this is the rule of three: 99 %
needs 299 packets, 99.99999 % needs 29 957 322. Runs of failures raise the upper bound; the lower bound counts every
failure in full, since a requirement also excludes runs.
"""

from math import ceil, inf, log, log1p, sqrt
from statistics import NormalDist
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.metrics.fidelity import batch_inflation, gilbert_inflation, share_bounds
from tis.common.metrics.loss import loss_runs
from tis.common.metrics.percentiles import summarise

Outcome = Literal["met", "missed", "not_decidable"]
Obstacle = Literal["unknown", "too_few", "clock"]
"""Reason for an open verdict: not measured, too few values, or an uncertain clock offset."""

CONFIDENCE: Final = 0.95
"""Confidence of a bound: of runs exactly at the limit one in twenty is judged met, and one in twenty missed."""

_MIN_SQUARES: Final = 30


class Judgement(NamedTuple):
    """The verdict on one requirement.

    ``value`` must not exceed the limit; ``excess`` is how far it does. Of ``n`` observations ``n_outside`` were
    beyond the limit; ``n_needed`` is the approximate number that would decide, where ``obstacle`` is too_few.
    """

    outcome: Outcome
    value: float | None
    excess: float | None
    n: int
    n_outside: int | None
    n_needed: int | None
    obstacle: Obstacle | None


UNKNOWN: Final = Judgement("not_decidable", None, None, 0, None, None, "unknown")
"""Judgement where nothing was measured."""


def judge_percentile(
    values: NDArray[np.float64], percentile: float, limit: float, uncertainty: NDArray[np.float64] | float = 0.0
) -> Judgement:
    """Judge whether ``percentile`` % of the population of ``values`` (N,) do not exceed ``limit``.

    The values may all be off by up to ``uncertainty``, (N,) or scalar, in the same direction, as one-way delays
    between two clocks; a decision must hold at both ends. Oracle: `scipy.stats.binomtest` and counts worked by hand,
    test_verdict.
    """
    n = len(values)
    if n == 0:
        return UNKNOWN
    p_allowed = 1.0 - percentile / 100.0
    # Values beyond the limit: certainly, as measured, and possibly.
    sure, seen, perhaps = (values > limit + offset for offset in (uncertainty, 0.0, -uncertainty))
    value = summarise(values, (percentile,), ())[f"p{percentile:g}"]
    assert value is not None
    outcome = _decided(sure, perhaps, p_allowed)
    n_outside = _count(seen)
    if outcome != "not_decidable":
        excess = value - limit if outcome == "missed" else None
        return Judgement(outcome, value, excess, n, n_outside, None, None)
    # Without the clocks' uncertainty the values would decide, so more values would not help.
    if _decided(seen, seen, p_allowed) != "not_decidable":
        return Judgement(outcome, value, None, n, n_outside, None, "clock")
    return Judgement(outcome, value, None, n, n_outside, _needed(seen, p_allowed), "too_few")


def judge_loss(lost: NDArray[np.bool_], limit_pct: float) -> Judgement:
    """Judge whether at most ``limit_pct`` % of messages are lost, from ``lost`` (N,), in the order of sending.

    A limit of 0 concerns these messages only, since no sample can show that losses never occur. Oracle: as for
    `judge_percentile`.
    """
    n, n_lost = len(lost), _count(lost)
    if n == 0:
        return UNKNOWN
    value = 100.0 * n_lost / n
    p_allowed = limit_pct / 100.0
    outcome: Outcome
    outcome = ("missed" if n_lost else "met") if p_allowed == 0.0 else _decided(lost, lost, p_allowed)
    excess = value - limit_pct if outcome == "missed" else None
    undecided = outcome == "not_decidable"
    needed = _needed(lost, p_allowed) if undecided else None
    return Judgement(outcome, value, excess, n, n_lost, needed, "too_few" if undecided else None)


def judge_rms(errors: NDArray[np.float64], limit: float) -> Judgement:
    """Judge whether the root mean square of ``errors`` (N,), one per tick and >= 0, does not exceed ``limit``.

    The mean square is assumed normal, with a variance that allows for correlation (batch means); below 30
    independent ticks there is no decision. Oracle: coverage in simulations of correlated errors, test_verdict.
    """
    n = len(errors)
    if n == 0:
        return UNKNOWN
    squares = errors**2
    mean, variance = float(squares.mean()), float(squares.var())
    inflation = batch_inflation(squares - mean, variance)
    effective = n / inflation
    margin = NormalDist().inv_cdf(CONFIDENCE) * sqrt(variance / effective)
    value = sqrt(mean)
    if effective < _MIN_SQUARES:
        needed = ceil(_MIN_SQUARES * inflation)
        return Judgement("not_decidable", value, None, n, None, needed, "too_few")
    if mean + margin <= limit**2:
        return Judgement("met", value, None, n, None, None, None)
    if mean - margin > limit**2:
        return Judgement("missed", value, value - limit, n, None, None, None)
    gap = abs(mean - limit**2)
    return Judgement("not_decidable", value, None, n, None, ceil(n * (margin / gap) ** 2) if gap else None, "too_few")


def judge_maximum(values: NDArray[np.float64], limit: float) -> Judgement:
    """Judge whether no value of this run, (N,), exceeds the limit; it says nothing of other runs."""
    n = len(values)
    if n == 0:
        return UNKNOWN
    value = float(values.max())
    n_outside = _count(values > limit)
    if n_outside:
        return Judgement("missed", value, value - limit, n, n_outside, None, None)
    return Judgement("met", value, None, n, 0, None, None)


def min_packets(p_allowed: float) -> int:
    """Return the number of packets, none beyond the limit, that prove a share of at most ``p_allowed`` > 0.

    The least n with (1 - p)^n <= 5 %: the rule of three, about 3 / p. Oracle: exact fractions, test_verdict.
    """
    return 1 if p_allowed >= 1.0 else ceil(log(1.0 - CONFIDENCE) / log1p(-p_allowed))


def combined(outcomes: list[Outcome]) -> Outcome:
    """Return the common outcome of requirements that must all be met."""
    for outcome in ("missed", "not_decidable"):
        if outcome in outcomes:
            return outcome
    return "met" if outcomes else "not_decidable"


def _decided(sure: NDArray[np.bool_], perhaps: NDArray[np.bool_], p_allowed: float) -> Outcome:
    """Return the outcome for a share of failures, from certain (``sure``) and possible ones (``perhaps``)."""
    level = 2.0 * (1.0 - CONFIDENCE)  # share_bounds has two ends, each of which is used alone
    n, inflation = len(sure), _inflation(perhaps)
    high = 1.0 if inflation == inf else share_bounds(_count(perhaps) / inflation, n / inflation, level)[1]
    if high <= p_allowed:
        return "met"
    return "missed" if share_bounds(_count(sure), n, level)[0] > p_allowed else "not_decidable"


def _count(failed: NDArray[np.bool_]) -> int:
    return int(np.count_nonzero(failed))


def _inflation(failed: NDArray[np.bool_]) -> float:
    """Return the inflation of the variance of the share of failures by runs; 1 where all or none failed.

    The larger of that of Gilbert's model and that of batch means.
    """
    n, n_failed = len(failed), _count(failed)
    if n_failed in (0, n):
        return 1.0
    p, burst = n_failed / n, loss_runs(failed).mean_burst
    assert burst is not None
    return max(gilbert_inflation(p, burst), batch_inflation(failed.astype(np.float64) - p, p * (1.0 - p)))


def _needed(failed: NDArray[np.bool_], p_allowed: float) -> int | None:
    """Return the approximate number of packets that decide for this share of failures; None: no number does."""
    p, least = float(np.mean(failed)), min_packets(p_allowed)
    if p == 0.0:
        return least
    if p == p_allowed:
        return None
    # Normal approximation: the bound reaches the limit when z standard errors equal the distance to it.
    z = NormalDist().inv_cdf(CONFIDENCE)
    spread = max(p * (1.0 - p), p_allowed * (1.0 - p_allowed))
    needed = _inflation(failed) * z * z * spread / (p - p_allowed) ** 2
    return max(least, ceil(needed), len(failed) + 1)
