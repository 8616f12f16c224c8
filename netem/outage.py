"""Outages by timeline: stretches of run time in which every packet that a direction is offered is lost."""

from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

from common.channels import Direction
from common.scenario.network import TimelineEntry
from common.units import NS_PER_MS, s_to_ns


@dataclass(frozen=True)
class Outages:
    """The edges of all outages in ns of run time, ascending and on the 1 ms grid: down, up, down, up, ..."""

    edges_ns: tuple[int, ...] = ()

    @classmethod
    def of_timeline(cls, timeline: Iterable[TimelineEntry], direction: Direction) -> Self:
        """Return the outages of one direction; overlapping and touching ones are one.

        The grid's cell c is run time [c, c + 1) ms. Both edges of an entry move to the nearest cell; an
        outage is never shorter than one cell.
        """
        cells = sorted(
            (first, max(first + 1, _nearest_cell(entry.at_s + entry.for_s)))
            for entry in timeline
            if entry.direction in (direction, "both")
            for first in (_nearest_cell(entry.at_s),)
        )
        merged: list[list[int]] = []
        for first, stop in cells:
            if merged and first <= merged[-1][1]:
                merged[-1][1] = max(merged[-1][1], stop)
            else:
                merged.append([first, stop])
        return cls(tuple(cell * NS_PER_MS for stretch in merged for cell in stretch))

    def holds(self, now_ns: int) -> bool:
        """Return whether the cell of ``now_ns`` is out (oracle: a table of cells, tests/netem/test_outage).

        Since the edges lie on the grid, comparing instants with them is comparing cells.
        """
        return bisect_right(self.edges_ns, now_ns) % 2 == 1


def _nearest_cell(seconds: float) -> int:
    return (2 * s_to_ns(seconds) + NS_PER_MS) // (2 * NS_PER_MS)
