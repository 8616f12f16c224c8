"""Steps in a record: delays whose level changes at a fixed period, as when a satellite terminal changes its path."""

from math import log
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_MS, NS_PER_S
from tis.netem.draws.blocks import Floats
from tis.netem.fit.cycle import period_of
from tis.netem.fit.record import rounded

_WIDTH_S: Final = 0.25
_BESIDE: Final = (8, 12)
_FRACTIONS: Final = (1, 2, 3, 5)
_MIN_STEPS: Final = 8
_MIN_PERIOD_S: Final = 4.0
_EXPLAINED: Final = 0.3
_ADVANTAGE: Final = 0.1
_FINE: Final = 81
_MAX_POINTS: Final = 21
_MAX_BINS: Final = 400_000


class FoundSteps(NamedTuple):
    """The ``process`` as an entry of ``steps``, the values in ms (n,), and what each message has of them, (N,)."""

    process: dict[str, Any]
    values_ms: Floats
    added_ns: NDArray[np.int64]

    def removed_from(self, trace: Trace) -> Trace:
        """Return the record without the steps."""
        without = np.maximum(trace.delay_ns - self.added_ns, 0)
        return Trace(trace.label, trace.sent_ns, np.where(trace.delay_ns >= 0, without, LOST))


def find_steps(trace: Trace) -> FoundSteps | None:
    """Return the steps of a record; None with fewer than eight, or without a period.

    The level's changes, between some seconds before and after each quarter of a second, tell periods; of these and
    their fractions the one with the best BIC is taken. Its steps explain 30 % of the variance of the delays, and a
    tenth more than those half a period off.
    Oracle: steps that the tests put in, and none, tests/netem/fit/test_steps.
    """
    received = np.flatnonzero(trace.delay_ns >= 0)
    sent_s = (trace.sent_ns[received] - trace.sent_ns[0]) / NS_PER_S
    delay_ms = trace.delay_ns[received] / NS_PER_MS
    levels = _levels(sent_s, delay_ms)
    if levels is None:
        return None
    at_s = np.asarray((np.arange(len(levels)) + 0.5) * _WIDTH_S, dtype=np.float64)
    tried = [_refined(at_s, levels, period_s) for period_s in _periods(levels)]
    if not tried:
        return None
    best = min(tried, key=lambda at: _criterion(_numbers(at_s, *at), levels))
    period_s, first_s = _refined(sent_s, delay_ms, best[0])
    number = _numbers(sent_s, period_s, first_s)
    explained, off = (
        _explained(_numbers(sent_s, period_s, at), delay_ms) for at in (first_s, first_s - period_s / 2)
    )
    if number[-1] + 1 < _MIN_STEPS or explained < max(_EXPLAINED, off + _ADVANTAGE):
        return None
    medians = np.array([np.median(delay_ms[number == k]) for k in np.unique(number)])
    base_ms = float(medians.min())
    added_ms = np.zeros(int(number[-1]) + 1)
    added_ms[np.unique(number)] = medians - base_ms
    shares = np.linspace(0, 1, min(len(medians), _MAX_POINTS))
    points = [
        {"p": rounded(float(p), 6), "delay_ms": rounded(float(q), 6)}
        for p, q in zip(shares, np.quantile(medians - base_ms, shares), strict=True)
    ]
    process = {
        "every_s": rounded(period_s, 6),
        "first_s": rounded(first_s, 6),
        "delay": {"kind": "quantiles", "points": points},
    }
    every = np.minimum(_numbers((trace.sent_ns - trace.sent_ns[0]) / NS_PER_S, period_s, first_s), len(added_ms) - 1)
    return FoundSteps(process, medians - base_ms, np.rint(added_ms[every] * NS_PER_MS).astype(np.int64))


def _periods(levels: Floats) -> list[float]:
    """Return periods in s that the changes of the level may have."""
    sums, found = np.concatenate([[0.0], np.cumsum(levels)]), list[float]()
    for beside in _BESIDE:
        middle = np.arange(beside, len(levels) - beside)
        changes = np.zeros(len(levels))
        changes[middle] = np.abs(sums[middle + beside] - 2 * sums[middle] + sums[middle - beside])
        period_s, _ = period_of(changes - changes.mean(), _WIDTH_S)
        found += [period_s / part for part in _FRACTIONS if period_s / part >= _MIN_PERIOD_S]
    return found


def _criterion(number: NDArray[np.int64], levels: Floats) -> float:
    """Return BIC of a level for each step, by the levels of each second."""
    n = len(levels) * _WIDTH_S
    return n * log(max(1.0 - _explained(number, levels), 1e-12)) + (int(number[-1]) + 1) * log(n)


def _levels(sent_s: Floats, delay_ms: Floats) -> Floats | None:
    """Return the mean delay of each quarter of a second, that of the one before it where none arrived."""
    if len(sent_s) < _MIN_STEPS or not _MIN_STEPS * _MIN_PERIOD_S < sent_s[-1] < _MAX_BINS * _WIDTH_S:
        return None
    place = (sent_s / _WIDTH_S).astype(np.int64)
    count = np.bincount(place)
    known = np.maximum.accumulate(np.where(count > 0, np.arange(len(count)), 0))
    known = np.maximum(known, place[0])
    return np.asarray((np.bincount(place, delay_ms) / np.maximum(count, 1))[known])


def _numbers(sent_s: Floats, period_s: float, first_s: float) -> NDArray[np.int64]:
    """Return the number of the step of each message, (N,), 0 before the first change."""
    return np.maximum(np.floor((sent_s - first_s) / period_s).astype(np.int64) + 1, 0)


def _explained(number: NDArray[np.int64], delay_ms: Floats) -> float:
    """Return the share of the variance of delays, (N,), that lies between their steps."""
    count = np.maximum(np.bincount(number), 1)
    means = np.bincount(number, delay_ms) / count
    variance = float(delay_ms.var())
    return float((count * (means - delay_ms.mean()) ** 2).sum() / len(delay_ms)) / variance if variance > 0 else 0.0


def _refined(sent_s: Floats, delay_ms: Floats, period_s: float) -> tuple[float, float]:
    """Return the period, and the time of the first change, at which the steps explain most."""
    n_steps = max(1.0, float(sent_s[-1]) / period_s)

    def best(tried: list[tuple[float, float]]) -> tuple[float, float]:
        return max(tried, key=lambda at: _explained(_numbers(sent_s, *at), delay_ms))

    first_s = best([(period_s, float(at)) for at in np.arange(_WIDTH_S, period_s + _WIDTH_S, _WIDTH_S)])[1]
    for reach_s in (4 * _WIDTH_S, _WIDTH_S, _WIDTH_S / 8):
        off = np.linspace(-reach_s, reach_s, _FINE)
        # the period turns about the middle of the record, so that it can be found apart from the time
        turned = [(period_s + float(by) / n_steps, first_s - float(by) / 2) for by in off]
        period_s, first_s = best(turned)
        first_s = best([(period_s, first_s + float(by)) for by in off])[1]
    return period_s, first_s % period_s or period_s
