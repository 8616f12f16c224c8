"""Stalls in a record: moments in which nothing leaves, after which all that waited arrives at once."""

from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.trace import LOST, Trace
from tis.common.units import NS_PER_S
from tis.netem.draws.blocks import Floats
from tis.netem.fit.outage_runs import process_of

_MIN_STALLS: Final = 4
_MIN_STALL_S: Final = 0.04
_MIN_WAITING: Final = 3
_USUAL: Final = 0.99
_RATIO: Final = 2.0
_OWN: Final = 0.5
_TOGETHER: Final = 0.7


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
