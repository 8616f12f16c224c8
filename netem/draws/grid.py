"""The grid of run time: cell c is [c, c + 1) ms. Conditions change at the edges of cells only.

On it lie endless paths of stretches of random length, and the rows of a recording, which repeats when it ends.
"""

from abc import ABC, abstractmethod
from bisect import bisect_right
from collections.abc import Callable
from math import gcd
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import BLOCK, Stream
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.draws.blocks import Counts, Floats

CELL_NS: Final = NS_PER_MS
CELLS_PER_S: Final = 1000.0
LAST_CELL: Final = (2**63 - 1) // CELL_NS
"""The end of a stretch without an end; its edge in ns still fits an int64."""

_HALF_NS: Final = CELL_NS // 2
_MAX_KEPT_CHUNKS: Final = 4


class Stretch(NamedTuple):
    """Cells ``begin`` .. ``end - 1`` and the value that holds in them."""

    begin: int
    end: int
    value: int


class Path(ABC):
    """A piecewise constant value over run time."""

    @abstractmethod
    def at(self, cell: int) -> Stretch:
        """Return the stretch that contains ``cell`` >= 0; neighbours may have the same value."""

    def prepare(self, cell: int) -> None:  # noqa: B027 - most paths have nothing to draw
        """Make the draws after ``cell`` ahead of their use."""


def cell_of(now_ns: int) -> int:
    """Return the cell of an instant; instants before the run are in cell 0."""
    return max(0, now_ns // CELL_NS)


def nearest_cell(instant_ns: int) -> int:
    """Return the cell that begins nearest to an instant; of two, the later."""
    return (instant_ns + _HALF_NS) // CELL_NS


def deciding_ns(cell: int) -> int:
    """Return the latest instant that `nearest_cell` maps to ``cell`` or an earlier one."""
    return cell * CELL_NS + _HALF_NS - 1


def mean_cells(begin_ns: int, length_ns: int, every_ns: int) -> float:
    """Return the mean length, in cells, of a window with period ``every_ns`` after both edges move to the grid.

    The beginnings k * every_ns + begin_ns visit a lattice of gcd(every_ns, 1 ms) within a cell evenly, so rounding
    moves an edge x by a constant minus (x + half a cell) mod gcd on average (oracle: counted, test_outage).
    """
    lattice_ns = gcd(every_ns, CELL_NS)
    before_ns = (begin_ns + _HALF_NS) % lattice_ns
    behind_ns = (begin_ns + length_ns + _HALF_NS) % lattice_ns
    return (length_ns + before_ns - behind_ns) / CELL_NS


Cells = NDArray[np.int64]
Draw = Callable[[int, int], tuple[Cells, NDArray[np.integer]]]


class RenewalPath(Path):
    """A path of stretches; ``draw(number, before)`` returns lengths (N,) >= 1 and values (N,) of one chunk.

    ``before`` is the value of the last stretch of the previous chunk, 0 for the first chunk. ``draw`` must depend on
    its arguments alone; then the path is the same in any order of access (oracle: one walk in order, test_outage).

    The place of a stretch depends on the lengths of all earlier ones, drawn in chunks of one block of uniforms. Only
    the first cell of a chunk and the value before it are kept, so a day of the shortest stretches takes some MB;
    chunks are drawn again when needed.
    """

    def __init__(self, draw: Draw) -> None:
        self._draw = draw
        self._begins = [0]  # the first cell of each known chunk, and of the next one
        self._befores = [0]
        self._chunks: dict[int, tuple[Cells, NDArray[np.integer]]] = {}
        self._held = Stretch(0, 0, 0)

    def at(self, cell: int) -> Stretch:
        """Return the stretch that contains ``cell`` >= 0; neighbours may have the same value."""
        held = self._held
        if not held.begin <= cell < held.end:
            held = self._held = self._find(cell)
        return held

    def prepare(self, cell: int) -> None:
        """Draw the chunk after the one that contains ``cell``."""
        self.at(cell)
        self._known_to(self._begins[bisect_right(self._begins, cell)])

    def _find(self, cell: int) -> Stretch:
        self._known_to(cell)
        number = bisect_right(self._begins, cell) - 1
        ends, values = self._chunk(number)
        i = int(ends.searchsorted(cell, side="right"))
        begin = int(ends[i - 1]) if i else self._begins[number]
        return Stretch(begin, int(ends[i]), int(values[i]))

    def _known_to(self, cell: int) -> None:
        while cell >= self._begins[-1]:
            ends, values = self._chunk(len(self._begins) - 1)
            self._begins.append(int(ends[-1]))
            self._befores.append(int(values[-1]))

    def _chunk(self, number: int) -> tuple[Cells, NDArray[np.integer]]:
        chunk = self._chunks.get(number)
        if chunk is None:
            lengths, values = self._draw(number, self._befores[number])
            chunk = (self._begins[number] + np.cumsum(lengths), values)
            if len(self._chunks) >= _MAX_KEPT_CHUNKS:
                del self._chunks[next(iter(self._chunks))]
            self._chunks[number] = chunk
        return chunk


def alternating(stream: Stream, off: Callable[[Floats], Cells], on: Callable[[Floats], Cells]) -> RenewalPath:
    """Return a path of values 0 and 1 that begins with 0; ``off`` and ``on`` map uniforms to lengths of stretches.

    Uniform 2k decides the stretch before the one of value 1 number k, uniform 2k + 1 that one.
    """
    values = np.tile(np.array([0, 1], np.int64), BLOCK // 2)

    def draw(number: int, _: int) -> tuple[Cells, Cells]:
        u = stream.block(number)
        return np.stack([off(u[0::2]), on(u[1::2])], axis=1).ravel(), values

    return RenewalPath(draw)


def geometric_cells(u: Floats, mean: Floats | float) -> Cells:
    """Return geometric lengths of at least one cell, shape of ``u``: the exponential distribution on the grid.

    P(L > k) = (1 - 1/mean)^k, so the mean is exact and the process is memoryless. ``mean`` >= 1 is in cells; with 1
    every length is 1. (Devroye, "Non-Uniform Random Variate Generation", 1986, chapter X.2.)
    """
    with np.errstate(divide="ignore"):
        lengths = np.ceil(np.log(u) / np.log1p(-1.0 / np.asarray(mean, np.float64)))
    return np.maximum(lengths, 1.0).astype(np.int64)


def row_of_packet(n_rows: int, seqs: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows of packets ``seqs``, same shape: packet i takes row i mod ``n_rows``."""
    return seqs % n_rows


def span_ns(trace: Trace) -> int:
    """Return the period of a trace that repeats, in ns: a whole number of ms, at least one.

    The last row lasts the mean interval of the rows, rounded up to the grid: so it is not skipped, and every
    repetition uses the same rows.
    """
    between = int(trace.sent_ns[-1] - trace.sent_ns[0])
    n_rows = len(trace.sent_ns)
    lasts = between * n_rows // (n_rows - 1) if n_rows > 1 else 0
    return max(1, -(-lasts // CELL_NS)) * CELL_NS


def row_of_cell(trace: Trace, cells: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows for ``cells`` of 1 ms of run time, same shape.

    It is the latest row sent at or before the beginning of the cell, modulo the period (oracle: a search row by row,
    tests/netem/draws/test_trace_rows).
    """
    instants_ns = trace.sent_ns[0] + cells * CELL_NS % span_ns(trace)
    return np.asarray(np.searchsorted(trace.sent_ns, instants_ns, side="right"), np.int64) - 1


def rows_of_block(trace: Trace, counts: Counts, number: int) -> NDArray[np.int64]:
    """Return the rows of block ``number`` of a trace's draws, (BLOCK,), by packet or by cell."""
    index = np.arange(number * BLOCK, (number + 1) * BLOCK)
    return row_of_packet(len(trace.sent_ns), index) if counts == "packet" else row_of_cell(trace, index)


def cells_of_rows(trace: Trace) -> NDArray[np.int64]:
    """Return the number of cells of the period in which each row holds, (N,). Oracle: `row_of_cell`."""
    # the first cell that begins at the row or later
    first_cells = -(-(trace.sent_ns - trace.sent_ns[0]) // CELL_NS)
    return np.asarray(np.diff(first_cells, append=span_ns(trace) // CELL_NS), np.int64)
