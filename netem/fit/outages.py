"""Outages and stalls in a record, each with the process that makes them.

Outages are runs of losses that are too long for the record's bursts; stalls are moments in which nothing leaves,
after which all that waited arrives at once.
"""

from functools import partial
from math import log, sqrt
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_S
from tis.netem.draws.blocks import Floats
from tis.netem.fit.record import rounded

_MIN_OUTAGE_S: Final = 0.05
_MIN_RATIO: Final = 5.0
"""The shortest outage in mean bursts; nearer ones are not told apart from long bursts."""

_MAX_EXPECTED: Final = 0.02
"""Number of bursts as long as the shortest outage that the bursts themselves would have in the record, at most."""

_ERRORS: Final = 2.0
_CONSTANT: Final = 0.1
_rounded: Final = partial(rounded, digits=6)
_ENOUGH: Final = 4
_MIN_STALLS: Final = 4
_MIN_STALL_S: Final = 0.04
_MIN_WAITING: Final = 3
_USUAL: Final = 0.99
_RATIO: Final = 2.0
_OWN: Final = 0.5
_TOGETHER: Final = 0.7


class FoundOutages(NamedTuple):
    """Runs of losses that are outages: ``process`` as an entry of ``outages``, None without any.

    ``begins_s`` and ``lengths_s`` (n,) are run times of the record. ``within`` (N,) tells which messages fell into
    them.
    """

    process: dict[str, Any] | None
    begins_s: Floats
    lengths_s: Floats
    within: NDArray[np.bool_]


def find_outages(trace: Trace) -> FoundOutages:
    """Return the outages of a record: its longest runs of losses, as far as no burst of the rest could be as long.

    The longest runs are taken one by one until the next one is plausible: until the geometric distribution of the
    remaining runs expects more than 0.02 runs of its length, or it is shorter than 5 mean runs or than 50 ms. An
    outage lasts from the middle between the last message before it and its first lost one. Oracle: outages that the
    tests cut out, tests/netem/fit/test_outage_runs.
    """
    lost = trace.delay_ns < 0
    edges = np.flatnonzero(np.diff(lost.astype(np.int8), prepend=0, append=0))
    firsts, stops = edges[::2], edges[1::2]
    lengths = stops - firsts
    sent_s = (trace.sent_ns - trace.sent_ns[0]) / NS_PER_S
    interval_s = float(np.median(np.diff(sent_s))) if len(sent_s) > 1 else 0.0
    before_s = np.concatenate([[sent_s[0]], sent_s, [sent_s[-1] + interval_s]])
    begins_s, ends_s = (before_s[firsts] + before_s[firsts + 1]) / 2, (before_s[stops] + before_s[stops + 1]) / 2
    n_long = _n_outages(lengths, ends_s - begins_s)
    which = np.sort(np.argsort(lengths, kind="stable")[len(lengths) - n_long :])
    within = np.zeros(len(lost), dtype=np.bool_)
    for first, stop in zip(firsts[which], stops[which], strict=True):
        within[first:stop] = True
    begins, durations = begins_s[which], ends_s[which] - begins_s[which]
    process = process_of(begins, durations, float(sent_s[-1]) + interval_s) if n_long else None
    return FoundOutages(process, begins, durations, within)


def _n_outages(lengths: NDArray[np.int64], seconds: Floats) -> int:
    """Return how many of the longest runs are outages: the largest number that all rules allow."""
    order = np.sort(lengths)[::-1]
    by_time = np.sort(seconds)[::-1]
    found = 0
    for n_long in range(1, len(order) + 1):
        rest = order[n_long:]
        shortest = int(order[n_long - 1])
        if by_time[n_long - 1] < _MIN_OUTAGE_S:
            break
        mean = float(rest.mean()) if len(rest) else 1.0
        # the upper end of the mean's confidence interval: few runs say little about their tail
        tail = (1.0 - 1.0 / (mean * (1.0 + _ERRORS / sqrt(len(rest) + 1)))) ** (shortest - 1)
        if shortest >= _MIN_RATIO * mean and (len(rest) + 1) * tail <= _MAX_EXPECTED:
            found = n_long
    return found


def process_of(begins_s: Floats, lengths_s: Floats, duration_s: float) -> dict[str, Any]:
    """Return the entry of ``outages`` that is most likely, by BIC; few outages are memoryless."""
    ends_s = begins_s + lengths_s
    gaps_s = begins_s[1:] - ends_s[:-1]
    up_s = duration_s - float(lengths_s.sum())
    mean_s, mean_gap_s = float(lengths_s.mean()), max(up_s / len(begins_s), 0.001)
    spread = float(lengths_s.std()) / mean_s
    steps_s = np.diff(begins_s)
    if (
        len(begins_s) >= _ENOUGH
        and spread < _CONSTANT
        and float(steps_s.std()) < _CONSTANT / 2 * float(steps_s.mean())
    ):
        every_s = float(np.polyfit(np.arange(len(begins_s)), begins_s, 1)[0])
        first_s = float(np.mean(begins_s - every_s * np.arange(len(begins_s))))
        return {
            "kind": "periodic",
            "every_s": _rounded(every_s),
            "for_s": _rounded(mean_s),
            "first_s": _rounded(max(0.0, first_s)),
        }
    if len(begins_s) >= 8 and _uniform_gain(lengths_s) + _uniform_gain(gaps_s) > 2 * log(len(begins_s)):
        return {"kind": "alternating", "down": _span(lengths_s), "up": _span(gaps_s)}
    process = {"kind": "poisson", "mean_gap_s": _rounded(mean_gap_s), "mean_s": _rounded(max(mean_s, 0.001))}
    equal = len(begins_s) == 1 or (len(begins_s) >= _ENOUGH and spread < _CONSTANT)
    return {**process, "lengths": "constant"} if equal else process


def _uniform_gain(x: Floats) -> float:
    """Return by how many nats a uniform distribution explains ``x`` (n,) better than an exponential one."""
    width = max(float(x.max() - x.min()), 1e-3 * float(x.mean()))
    return len(x) * (log(float(x.mean())) + 1.0 - log(width * (len(x) + 1) / (len(x) - 1)))


def _span(x: Floats) -> dict[str, float]:
    """Return the bounds of a uniform distribution: beyond the extremes by the mean distance of ordered values."""
    beyond = float(x.max() - x.min()) / (len(x) - 1)
    return {"low_s": _rounded(max(0.0, float(x.min()) - beyond)), "high_s": _rounded(float(x.max()) + beyond)}


class FoundStalls(NamedTuple):
    """Stalls: ``process`` as an entry of ``outages``; ``begins_s`` and ``lengths_s`` (n,) in run time of the record.

    ``wait_ns`` (N,) is the time that each message waited for the end of a stall, 0 for most.
    """

    process: dict[str, Any]
    begins_s: Floats
    lengths_s: Floats
    wait_ns: NDArray[np.int64]

    def removed_from(self, trace: Trace) -> Trace:
        """Return the record without the waits."""
        arrived = trace.delay_ns >= 0
        without = np.maximum(trace.delay_ns - self.wait_ns, 0)
        return Trace(trace.label, trace.sent_ns, np.where(arrived, without, LOST))


def find_stalls(trace: Trace) -> FoundStalls | None:
    """Return the stalls of a record; None with fewer than four.

    A stall is a gap between arrivals, twice as long as 99 of 100 and at least 40 ms, behind which the messages
    that were sent during it arrive together: the first of them is late by most of the gap, and 70 % of them come
    within the usual spread of delays. Lost messages make gaps too, but nothing waits behind these. Oracle: stalls
    that the tests put in, tests/netem/fit/test_stalls.
    """
    received = np.flatnonzero(trace.delay_ns >= 0)
    sent_s = (trace.sent_ns[received] - trace.sent_ns[0]) / NS_PER_S
    delay_s = trace.delay_ns[received] / NS_PER_S
    arrives_s = np.maximum.accumulate(sent_s + delay_s)
    gaps_s = np.diff(arrives_s)
    if not len(gaps_s):
        return None
    interval_s = float(np.median(np.diff(sent_s)))
    usual_s = float(np.median(delay_s))
    spread_s = float(np.quantile(delay_s, 0.95) - usual_s) + interval_s
    least_s = max(_MIN_STALL_S, 5 * interval_s, _RATIO * float(np.quantile(gaps_s, _USUAL)))
    begins, ends = list[float](), list[float]()
    for first in (np.flatnonzero(gaps_s > least_s) + 1).tolist():
        begin_s, end_s = float(sent_s[first]) - interval_s / 2, float(arrives_s[first]) - usual_s
        if end_s - begin_s < _OWN * gaps_s[first - 1] or (ends and begin_s < ends[-1]):
            continue
        waiting = slice(first, int(np.searchsorted(sent_s, end_s)))
        together = sent_s[waiting] + delay_s[waiting] <= arrives_s[first] + spread_s
        if len(together) >= _MIN_WAITING and together.mean() >= _TOGETHER:
            begins.append(begin_s)
            ends.append(end_s)
    if len(begins) < _MIN_STALLS:
        return None
    begins_s, ends_s = np.array(begins), np.array(ends)
    all_s = (trace.sent_ns - trace.sent_ns[0]) / NS_PER_S
    which = np.searchsorted(begins_s, all_s, side="right") - 1
    wait_s = np.where(which >= 0, ends_s[np.maximum(which, 0)] - all_s, 0.0)
    process = process_of(begins_s, ends_s - begins_s, float(all_s[-1]) + interval_s)
    return FoundStalls(
        {**process, "effect": "stall"},
        begins_s,
        ends_s - begins_s,
        np.rint(np.maximum(wait_s, 0.0) * NS_PER_S).astype(np.int64),
    )
