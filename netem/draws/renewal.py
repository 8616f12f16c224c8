"""An endless sequence of stretches of random length, with access at any run time.

The place of a stretch depends on the lengths of all earlier ones. They are drawn in chunks of one block of uniforms.
Only the first cell of a chunk and the value before it are kept, so a day of the shortest stretches takes some MB;
chunks are drawn again when needed.
"""

from bisect import bisect_right
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tis.netem.draws.blocks import BLOCK, Floats
from tis.netem.draws.grid import Stretch

PER_CHUNK: Final = BLOCK // 2
"""Pairs of uniforms in a chunk."""

_MAX_KEPT_CHUNKS: Final = 4

Cells = NDArray[np.int64]
Draw = Callable[[int, int], tuple[Cells, NDArray[np.integer]]]


class RenewalPath:
    """A path of stretches; ``draw(number, before)`` returns lengths (N,) >= 1 and values (N,) of one chunk.

    ``before`` is the value of the last stretch of the previous chunk, 0 for the first chunk. ``draw`` must depend on
    its arguments alone; then the path is the same in any order of access (oracle: one walk in order, test_outage).
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
        """Draw the chunk after the one that contains ``cell``, ahead of its use."""
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


def geometric_cells(u: Floats, mean: Floats | float) -> Cells:
    """Return geometric lengths of at least one cell, shape of ``u``: the exponential distribution on the grid.

    P(L > k) = (1 - 1/mean)^k, so the mean is exact and the process is memoryless. ``mean`` >= 1 is in cells; with 1
    every length is 1. (Devroye, "Non-Uniform Random Variate Generation", 1986, chapter X.2.)
    """
    with np.errstate(divide="ignore"):
        lengths = np.ceil(np.log(u) / np.log1p(-1.0 / np.asarray(mean, np.float64)))
    return np.maximum(lengths, 1.0).astype(np.int64)
