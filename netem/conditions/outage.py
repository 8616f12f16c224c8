"""Recurring outages: periodic, memoryless, or with alternating times up and down.

During an outage every packet offered in its direction is lost, or waits for its end. Edges lie on the grid of 1 ms of
run time.
"""

from collections.abc import Callable, Iterable
from math import floor
from typing import Final, Self

import numpy as np

from tis.common.channels import Direction
from tis.common.scenario.network.conditions import (
    AlternatingOutages,
    Outages,
    PeriodicOutages,
    PoissonOutages,
    Span,
)
from tis.common.streams import Stream
from tis.common.units import s_to_ns
from tis.netem.draws.blocks import BLOCK, Floats
from tis.netem.draws.grid import (
    CELL_NS,
    PER_CHUNK,
    Cells,
    Path,
    RenewalPath,
    Stretch,
    deciding_ns,
    geometric_cells,
    mean_cells,
    nearest_cell,
)

_CELLS_PER_S: Final = 1000.0


class Outage:
    """One outage process in one direction; it does not depend on the order of access.

    ``stalls``: packets wait for the end of an outage instead of being lost.
    """

    def __init__(self, path: Path, stalls: bool = False) -> None:
        self.stalls = stalls
        self._path = path

    @classmethod
    def of(cls, part: Outages, direction: Direction, seed: int, index: int) -> Self | None:
        """Return entry ``index`` of a network's outages; None if it does not concern ``direction``.

        A process of both directions draws from one shared stream, so its edges are the same in both.
        """
        if part.direction not in (direction, "both"):
            return None
        stalls = part.effect == "stall"
        if isinstance(part, PeriodicOutages):
            return cls(_Periodic(part), stalls)
        stream = Stream.named(seed, f"{part.direction}/*/outage/{index}")
        return cls(RenewalPath(_drawn(part, stream)), stalls)

    def at(self, cell: int) -> Stretch:
        """Return the stretch that contains ``cell`` >= 0, with value 1 during an outage.

        Oracle: a table of cells, test_outage.
        """
        return self._path.at(cell)

    def prepare(self, cell: int) -> None:
        """Make the draws after ``cell`` ahead of their use."""
        if isinstance(self._path, RenewalPath):
            self._path.prepare(cell)


def outages_of(parts: Iterable[Outages], direction: Direction, seed: int) -> tuple[Outage, ...]:
    """Return the outage processes of one direction."""
    found = (Outage.of(part, direction, seed, index) for index, part in enumerate(parts))
    return tuple(outage for outage in found if outage is not None)


def outage_share(part: Outages) -> float:
    """Return the long-run share of time in outage of one process, exactly, with the rounding to cells.

    For alternating and memoryless processes by the renewal theorem: mean down over mean down plus mean up (oracle: a
    long simulation and, for periodic ones, one superperiod counted cell by cell, tests/netem/conditions/test_outage).
    """
    if isinstance(part, PeriodicOutages):
        periodic = _Periodic(part)
        length = mean_cells(periodic.first_ns, periodic.for_ns, periodic.every_ns)
        return length * CELL_NS / periodic.every_ns
    if isinstance(part, AlternatingOutages):
        down, up = _mean_uniform_cells(part.down), _mean_uniform_cells(part.up)
        return down / (down + up)
    gap = part.mean_gap_s * _CELLS_PER_S
    down = float(_constant_cells(part.mean_s)) if part.lengths == "constant" else part.mean_s * _CELLS_PER_S
    return down / (gap + down)


class _Periodic:
    """Periodic outages; each nominal edge moves to its nearest cell by itself, so rounding does not accumulate."""

    def __init__(self, part: PeriodicOutages) -> None:
        self.every_ns = s_to_ns(part.every_s)
        self.for_ns = s_to_ns(part.for_s)
        self.first_ns = self.every_ns if part.first_s is None else s_to_ns(part.first_s)

    def at(self, cell: int) -> Stretch:
        since_first_ns = deciding_ns(cell) - self.first_ns
        if since_first_ns < 0:
            return Stretch(0, nearest_cell(self.first_ns), 0)
        into_ns = since_first_ns % self.every_ns
        down_ns = self.first_ns + since_first_ns - into_ns
        up_ns = down_ns + self.for_ns
        if into_ns < self.for_ns:
            return Stretch(nearest_cell(down_ns), nearest_cell(up_ns), 1)
        return Stretch(nearest_cell(up_ns), nearest_cell(down_ns + self.every_ns), 0)


def _drawn(part: PoissonOutages | AlternatingOutages, stream: Stream) -> Callable[[int, int], tuple[Cells, Cells]]:
    """Return the chunks of a process: uniform 2k decides the time up before outage k, uniform 2k + 1 its length."""
    values = np.tile(np.array([0, 1], np.int64), PER_CHUNK)

    def draw(number: int, _: int) -> tuple[Cells, Cells]:
        u = stream.uniforms(number * BLOCK, BLOCK)
        lengths = np.empty(BLOCK, np.int64)
        if isinstance(part, AlternatingOutages):
            lengths[0::2] = _uniform_cells(u[0::2], part.up)
            lengths[1::2] = _uniform_cells(u[1::2], part.down)
        else:
            lengths[0::2] = geometric_cells(u[0::2], part.mean_gap_s * _CELLS_PER_S)
            if part.lengths == "constant":
                lengths[1::2] = _constant_cells(part.mean_s)
            else:
                lengths[1::2] = geometric_cells(u[1::2], part.mean_s * _CELLS_PER_S)
        return lengths, values

    return draw


def _constant_cells(seconds: float) -> int:
    return max(1, nearest_cell(s_to_ns(seconds)))


def _uniform_cells(u: Floats, span: Span) -> Cells:
    low, high = span.low_s * _CELLS_PER_S, span.high_s * _CELLS_PER_S
    return np.maximum(1.0, np.floor(low + u * (high - low) + 0.5)).astype(np.int64)


def _mean_uniform_cells(span: Span) -> float:
    """Return E max(1, floor(X + 1/2)), X uniform over the span in cells.

    With n = floor(x + 1/2) the integral of floor(t + 1/2) from 0 to x is n x - n^2 / 2; it is counted from the cell
    nearest to the lower bound, so that no digits cancel.
    """
    low, high = span.low_s * _CELLS_PER_S, span.high_s * _CELLS_PER_S
    nearest = floor(low + 0.5)
    if high == low:
        return float(max(1, nearest))
    width = high - nearest
    n = floor(width + 0.5)
    mean = nearest + (n * width - n * n / 2) / (high - low)
    return mean + max(0.0, min(high, 0.5) - low) / (high - low)
