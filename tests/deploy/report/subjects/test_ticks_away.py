"""Ticks of the time without a side: counted as missed, left out, or not known."""

import numpy as np

from tis.deploy.logs.coverage import Coverage
from tis.deploy.report.subjects.ticks import TicksAway, ticks_away

S = 1_000_000_000


def test_a_log_without_gaps_has_none() -> None:
    assert ticks_away(np.arange(10), Coverage(), 10, 20) == TicksAway(0, 0)


def test_ticks_of_a_gap_count_or_are_left_out_as_the_run_says() -> None:
    """At 10 Hz the side is away from 1.05 to 1.55 s: ticks 11 to 15."""
    tick = np.setdiff1d(np.arange(30), np.arange(11, 16))
    away = ((S + S // 20, S + 11 * S // 20),)
    assert ticks_away(tick, Coverage(away=away), 10, 30) == TicksAway(5, 0)
    assert ticks_away(tick, Coverage(away=away, unknown=away, away_counts=False), 10, 30) == TicksAway(0, 5)


def test_what_a_killed_process_did_not_write_is_left_out() -> None:
    tick = np.setdiff1d(np.arange(30), np.arange(11, 16))
    gap = Coverage(away=((S, S + 6 * S // 10),), unknown=((S, S + S // 5),))
    assert ticks_away(tick, gap, 10, 30) == TicksAway(3, 2)


def test_ticks_missed_elsewhere_are_not_of_the_gap() -> None:
    tick = np.setdiff1d(np.arange(30), [3, 12, 25])
    assert ticks_away(tick, Coverage(away=((S, 2 * S),)), 10, 30) == TicksAway(1, 0)
