"""Ticks without their side, which was away until it was started anew."""

from typing import NamedTuple

import numpy as np

from tis.common.units import NS_PER_S
from tis.deploy.logs.coverage import Coverage, lies_in
from tis.deploy.logs.read.load import Ints


class TicksAway(NamedTuple):
    """Numbers of ticks that did not happen: those that count as missed, and those that figures leave out."""

    n_missed: int
    n_left_out: int


def ticks_away(tick: Ints, coverage: Coverage, rate_hz: int, n_ticks: int) -> TicksAway:
    """Return the ticks of the time without a side.

    Parameters
    ----------
    tick
        Numbers (N,) of the ticks in the side's log.
    coverage
        The gaps of that log.
    rate_hz, n_ticks
        Rate and number of the ticks of a whole run.

    Notes
    -----
    A tick within a gap that nobody knows is left out as well. Oracle: literals, test_ticks_away.
    """
    if not coverage.away:
        return TicksAway(0, 0)
    absent = np.setdiff1d(np.arange(n_ticks), tick)
    due_ns, period_ns = absent * NS_PER_S // rate_hz, NS_PER_S // rate_hz
    # the tick at a gap's edge belongs to it: the log has none of its number
    away = lies_in(due_ns, coverage.away, period_ns, 0)
    left_out = away & lies_in(due_ns, (*coverage.unknown, *coverage.left_out), period_ns, 0)
    return TicksAway(int((away & ~left_out).sum()), int(left_out.sum()))
