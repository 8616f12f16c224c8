"""Recurring outages: periodic, memoryless, or with alternating times up and down.

During an outage every packet offered in its direction is lost, or waits for its end. Edges lie on the grid of 1 ms of
run time.
"""

from collections.abc import Iterable
from functools import partial
from math import floor
from typing import NamedTuple, Self

import numpy as np

from tis.common.channels import Direction
from tis.common.scenario.network import conditions as network
from tis.common.streams import Stream
from tis.common.units import s_to_ns
from tis.netem.draws import grid
from tis.netem.draws.blocks import Floats
from tis.netem.draws.grid import Cells, Path, Stretch


class Outage(NamedTuple):
    """One outage process in one direction, a ``path`` of value 1 during an outage, in any order of access.

    ``stalls``: packets wait for the end of an outage instead of being lost. Oracle: a table of cells, test_outage.
    """

    path: Path
    stalls: bool

    @classmethod
    def of(cls, part: network.Outages, direction: Direction, seed: int, index: int) -> Self | None:
        """Return entry ``index`` of a network's outages; None if it does not concern ``direction``.

        A process of both directions draws from one shared stream, so its edges are the same in both.
        """
        if part.direction not in (direction, "both"):
            return None
        stream = Stream.named(seed, f"{part.direction}/*/outage/{index}")
        path = _Periodic(part) if isinstance(part, network.PeriodicOutages) else _drawn(part, stream)
        return cls(path, part.effect == "stall")


def outages_of(parts: Iterable[network.Outages], direction: Direction, seed: int) -> tuple[Outage, ...]:
    """Return the outage processes of one direction."""
    found = (Outage.of(part, direction, seed, index) for index, part in enumerate(parts))
    return tuple(outage for outage in found if outage is not None)


def outage_share(part: network.Outages) -> float:
    """Return the long-run share of time in outage of one process, exactly, with the rounding to cells.

    For alternating and memoryless processes by the renewal theorem: mean down over mean down plus mean up (oracle: a
    long simulation and, for periodic ones, one superperiod counted cell by cell, tests/netem/conditions/test_outage).
    """
    if isinstance(part, network.PeriodicOutages):
        periodic = _Periodic(part)
        length = grid.mean_cells(periodic.first_ns, periodic.for_ns, periodic.every_ns)
        return length * grid.CELL_NS / periodic.every_ns
    if isinstance(part, network.AlternatingOutages):
        down, up = _mean_uniform_cells(part.down), _mean_uniform_cells(part.up)
        return down / (down + up)
    gap = part.mean_gap_s * grid.CELLS_PER_S
    down = float(_constant_cells(part.mean_s)) if part.lengths == "constant" else part.mean_s * grid.CELLS_PER_S
    return down / (gap + down)


class _Periodic(Path):
    """Periodic outages; each nominal edge moves to its nearest cell by itself, so rounding does not accumulate."""

    def __init__(self, part: network.PeriodicOutages) -> None:
        self.every_ns = s_to_ns(part.every_s)
        self.for_ns = s_to_ns(part.for_s)
        self.first_ns = self.every_ns if part.first_s is None else s_to_ns(part.first_s)

    def at(self, cell: int) -> Stretch:
        since_first_ns = grid.deciding_ns(cell) - self.first_ns
        if since_first_ns < 0:
            return Stretch(0, grid.nearest_cell(self.first_ns), 0)
        into_ns = since_first_ns % self.every_ns
        down_ns = self.first_ns + since_first_ns - into_ns
        up_ns = down_ns + self.for_ns
        if into_ns < self.for_ns:
            return Stretch(grid.nearest_cell(down_ns), grid.nearest_cell(up_ns), 1)
        return Stretch(grid.nearest_cell(up_ns), grid.nearest_cell(down_ns + self.every_ns), 0)


def _drawn(part: network.PoissonOutages | network.AlternatingOutages, stream: Stream) -> Path:
    """Return the path of a process with random times up and down."""
    if isinstance(part, network.AlternatingOutages):
        up, down = (partial(_uniform_cells, span=span) for span in (part.up, part.down))
        return grid.alternating(stream, up, down)
    up = partial(grid.geometric_cells, mean=part.mean_gap_s * grid.CELLS_PER_S)
    if part.lengths == "constant":
        return grid.alternating(stream, up, lambda u: np.full(len(u), _constant_cells(part.mean_s)))
    return grid.alternating(stream, up, partial(grid.geometric_cells, mean=part.mean_s * grid.CELLS_PER_S))


def _constant_cells(seconds: float) -> int:
    return max(1, grid.nearest_cell(s_to_ns(seconds)))


def _uniform_cells(u: Floats, span: network.Span) -> Cells:
    low, high = span.low_s * grid.CELLS_PER_S, span.high_s * grid.CELLS_PER_S
    return np.maximum(1.0, np.floor(low + u * (high - low) + 0.5)).astype(np.int64)


def _mean_uniform_cells(span: network.Span) -> float:
    """Return E max(1, floor(X + 1/2)), X uniform over the span in cells.

    With n = floor(x + 1/2) the integral of floor(t + 1/2) from 0 to x is n x - n^2 / 2; it is counted from the cell
    nearest to the lower bound, so that no digits cancel.
    """
    low, high = span.low_s * grid.CELLS_PER_S, span.high_s * grid.CELLS_PER_S
    nearest = floor(low + 0.5)
    if high == low:
        return float(max(1, nearest))
    width = high - nearest
    n = floor(width + 0.5)
    mean = nearest + (n * width - n * n / 2) / (high - low)
    return mean + max(0.0, min(high, 0.5) - low) / (high - low)
