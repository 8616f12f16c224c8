"""Whether a run met what was required of it, missed it, or was too short to tell.

Every requirement is an upper limit. One on a percentile says how large a share may lie beyond the limit, and one on
loss how large a share may be lost, so both are decided by the bounds that Clopper and Pearson (1934) give for a
share: met, when even the upper one is allowed; missed, when the lower one is not. Where nothing lies beyond the limit
this is the rule of three: 99 % needs 299 packets, 99.99999 % needs 29 957 322. Failures that come in runs make the
upper bound larger; the lower one counts each in full, since a run of them is part of what a requirement rules out.
"""

from math import ceil, inf, log, log1p, sqrt
from statistics import NormalDist
from typing import Final, Literal, NamedTuple, TypedDict

import numpy as np
from numpy.typing import NDArray

from common.metrics.fidelity import batch_inflation, gilbert_inflation, share_bounds
from common.metrics.loss_runs import loss_runs
from common.metrics.percentiles import summarise

Outcome = Literal["met", "missed", "not_decidable"]
Obstacle = Literal["unknown", "too_few", "clock"]
"""Why nothing could be decided: it was not measured, there was too little of it, or the clocks were too far apart."""

CONFIDENCE: Final = 0.95
"""Of a bound: one in twenty runs at the very limit is judged met, and one in twenty missed."""

_LEAST_SQUARES: Final = 30


class Finding(TypedDict):
    """One requirement and how the run stood to it; an element of ``summary["verdicts"][i]["findings"]``.

    ``metric`` is `one_way`, `end_to_end`, `round_trip`, `network_round_trip`, `pdv`, `age`, `loss` or `rmse_3d`,
    ``direction`` forward, feedback or None. ``value`` must not exceed ``limit``, both in ``unit`` (ms, % or mm);
    ``value`` is the percentile ``percentile`` where that is not None. ``excess`` is by how much it was missed, else
    None; ``uncertainty`` what the clocks leave open, in ``unit``; ``aside`` what to know beside the
    figure. Of ``n`` packets ``n_outside`` were beyond the limit; ``n_needed`` is about how many would decide, where
    too few is the ``obstacle``. ``binding``: the set's outcome depends on it; the strict end of a range does not
    bind. ``sentence`` says it all in words.
    """

    metric: str
    direction: str | None
    title: str
    binding: bool
    unit: str
    limit: float
    percentile: float | None
    value: float | None
    uncertainty: float | None
    aside: str
    outcome: Outcome
    obstacle: Obstacle | None
    excess: float | None
    n: int
    n_outside: int | None
    n_needed: int | None
    sentence: str


class SetVerdict(TypedDict):
    """A set of requirements, an element of ``summary["verdicts"]``; ``name`` is `own` for the scenario's limits.

    ``outcome``: missed when a binding finding is, else not decidable when one is not, else met. ``line`` is the
    verdict in one line, as `tis run` prints it; ``source`` says who requires it.
    """

    name: str
    title: str
    source: str
    outcome: Outcome
    line: str
    findings: list[Finding]


class Judgement(NamedTuple):
    """What the kernels below decide; the names are those of `Finding`."""

    outcome: Outcome
    value: float | None
    excess: float | None
    n: int
    n_outside: int | None
    n_needed: int | None
    obstacle: Obstacle | None


UNKNOWN: Final = Judgement("not_decidable", None, None, 0, None, None, "unknown")
"""Nothing was measured."""


def judge_percentile(
    values: NDArray[np.float64], percentile: float, limit: float, uncertainty: NDArray[np.float64] | float = 0.0
) -> Judgement:
    """Judge that ``percentile`` % of what ``values`` (N,) are a sample of do not exceed ``limit``.

    Each value may be off by ``uncertainty``, (N,) or one for all, all in the same direction, as one-way delays
    between two clocks are: met and missed must hold at either end. Oracle: `scipy.stats.binomtest` and counts worked
    by hand, test_verdict.
    """
    n = len(values)
    if n == 0:
        return UNKNOWN
    p_allowed = 1.0 - percentile / 100.0
    sure, seen, perhaps = (values > limit + offset for offset in (uncertainty, 0.0, -uncertainty))
    value = summarise(values, (percentile,), ())[f"p{percentile:g}"]
    assert value is not None
    outcome = _decided(sure, perhaps, p_allowed)
    n_outside = _count(seen)
    if outcome != "not_decidable":
        excess = value - limit if outcome == "missed" else None
        return Judgement(outcome, value, excess, n, n_outside, None, None)
    if _decided(seen, seen, p_allowed) != "not_decidable":
        return Judgement(outcome, value, None, n, n_outside, None, "clock")
    return Judgement(outcome, value, None, n, n_outside, _needed(seen, p_allowed), "too_few")


def judge_loss(lost: NDArray[np.bool_], limit_pct: float) -> Judgement:
    """Judge that at most ``limit_pct`` % of messages get lost, from those that did, (N,), in the order of sending.

    A limit of 0 is about these messages alone, since no number of them shows that none ever will be. Oracle: as for
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
    """Judge that the root of the mean square of ``errors`` (N,), one a tick and >= 0, does not exceed ``limit``.

    The mean square is taken as normal with a variance that knows of the correlation (batch means); below 30
    independent ticks nothing is decided. Oracle: coverage in simulations of correlated errors, test_verdict.
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
    if effective < _LEAST_SQUARES:
        needed = ceil(_LEAST_SQUARES * inflation)
        return Judgement("not_decidable", value, None, n, None, needed, "too_few")
    if mean + margin <= limit**2:
        return Judgement("met", value, None, n, None, None, None)
    if mean - margin > limit**2:
        return Judgement("missed", value, value - limit, n, None, None, None)
    gap = abs(mean - limit**2)
    return Judgement("not_decidable", value, None, n, None, ceil(n * (margin / gap) ** 2) if gap else None, "too_few")


def least_needed(p_allowed: float) -> int:
    """Return how many packets, none of them beyond the limit, show that a share of at most ``p_allowed`` > 0 is.

    The least n with (1 - p)^n <= 5 %: the rule of three, about 3 / p. Oracle: exact fractions, test_verdict.
    """
    return 1 if p_allowed >= 1.0 else ceil(log(1.0 - CONFIDENCE) / log1p(-p_allowed))


def together(outcomes: list[Outcome]) -> Outcome:
    """Return the outcome of several requirements that must all be met."""
    for outcome in ("missed", "not_decidable"):
        if outcome in outcomes:
            return outcome
    return "met" if outcomes else "not_decidable"


def _decided(sure: NDArray[np.bool_], perhaps: NDArray[np.bool_], p_allowed: float) -> Outcome:
    """Return what the share of failures shows, when some are certain and some more are possible."""
    level = 2.0 * (1.0 - CONFIDENCE)
    n, inflation = len(sure), _inflation(perhaps)
    high = 1.0 if inflation == inf else share_bounds(_count(perhaps) / inflation, n / inflation, level)[1]
    if high <= p_allowed:
        return "met"
    return "missed" if share_bounds(_count(sure), n, level)[0] > p_allowed else "not_decidable"


def _count(failed: NDArray[np.bool_]) -> int:
    return int(np.count_nonzero(failed))


def _inflation(failed: NDArray[np.bool_]) -> float:
    """Return by how much runs of failures inflate the variance of their share; 1 where all or none failed.

    The larger of what the mean run tells (Gilbert's model) and what batches show.
    """
    n, n_failed = len(failed), _count(failed)
    if n_failed in (0, n):
        return 1.0
    p, burst = n_failed / n, loss_runs(failed).mean_burst
    assert burst is not None
    return max(gilbert_inflation(p, burst), batch_inflation(failed.astype(np.float64) - p, p * (1.0 - p)))


def _needed(failed: NDArray[np.bool_], p_allowed: float) -> int | None:
    """Return about how many packets would decide, were the share of failures what it was; None: no number would."""
    p, least = float(np.mean(failed)), least_needed(p_allowed)
    if p == 0.0:
        return least
    if p == p_allowed:
        return None
    z = NormalDist().inv_cdf(CONFIDENCE)
    spread = max(p * (1.0 - p), p_allowed * (1.0 - p_allowed))
    needed = _inflation(failed) * z * z * spread / (p - p_allowed) ** 2
    return max(least, ceil(needed), len(failed) + 1)
