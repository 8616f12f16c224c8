"""Ticks of both sides: how many there were, how many were missed, how late they began."""

from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from tis.common.channels import Side
from tis.common.metrics.latency import tick_summary
from tis.common.records import TICKS
from tis.common.scenario import Scenario
from tis.common.units import NS_PER_S
from tis.deploy.logs.coverage import Coverage, lies_in
from tis.deploy.logs.read.columns import Ints
from tis.deploy.logs.read.load import RunLogs
from tis.deploy.present.numbers import heads
from tis.deploy.present.table import Column, Table
from tis.deploy.report.section import Section, Statistics, means, statistics

_STATISTICS: Final = ("p50", "p95", "p99", "max")


class Ticks(Section):
    """The ticks of a side; the surgeon's are its sample instants."""

    rate_hz: int = means("Ticks a second.")
    count: int | None = means("Ticks that happened.")
    missed: int | None = means("Ticks that had not begun when the next one was due.")
    lateness_us: Statistics = statistics("From the nominal instant of a tick to its beginning.")
    planned: int = means("Ticks that the scenario plans.")


def tick_figures(logs: RunLogs, side: Side, scenario: Scenario) -> Ticks:
    """Return the ticks of a side; unknown without its log."""
    log = logs.sides[side] if logs.coverage(side) is not None else None
    empty = np.empty(0, dtype=np.int64)
    due = empty if log is None else log.of(TICKS).column("due_ns")
    begin = empty if log is None else log.of(TICKS).column("begin_ns")
    missed = empty.astype(np.bool_) if log is None else log.of(TICKS).column("missed").astype(np.bool_)
    found: dict[str, Any] = dict(tick_summary(scenario.rate_hz, due, begin, missed))
    if log is None:
        return Ticks(**found | {"count": None, "missed": None, "planned": scenario.n_samples})
    away = ticks_away(log.of(TICKS).column("tick"), log.coverage, scenario.rate_hz, scenario.n_samples)
    found["count"] += away.n_missed
    found["missed"] += away.n_missed
    return Ticks(**found, planned=scenario.n_samples - away.n_left_out)


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


def active_duration_s(logs: RunLogs, side: Side, scenario: Scenario) -> float:
    """Return how long a side ticked, in s; the planned duration where its log does not tell.

    Oracle: logs with a known number of ticks, tests/deploy/report/subjects/test_duration.
    """
    ticks = logs.of(side, TICKS).column("tick")
    n = int(ticks.max(initial=-1)) + 1
    return n / scenario.rate_hz if 0 < n < scenario.n_samples else scenario.duration_s


def tick_table(sides: Mapping[str, Ticks]) -> Table:
    """Return tick counts and lateness of both sides."""
    columns: tuple[Column | str, ...] = (
        "side",
        "ticks",
        "missed",
        *(Column(f"late, {name}", "\u00b5s") for name in heads(_STATISTICS)),
    )
    rows = [
        (side, ticks.count, ticks.missed, *(ticks.lateness_us[name] for name in _STATISTICS))
        for side, ticks in sides.items()
    ]
    return Table("Ticks, and how late they began", columns, rows)
