"""Stretches of random length, one after the other without end, that can be asked for anywhere.

Where a stretch lies depends on the lengths of all before it. They are drawn in chunks of one block of uniforms each;
of a chunk only its first cell and the value before it are kept, so a day of the shortest stretches takes some MB, and
the chunks that are asked for are drawn again.
"""

from bisect import bisect_right
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from netem.draws.blocks import BLOCK, Floats
from netem.draws.grid import Stretch

PER_CHUNK: Final = BLOCK // 2
"""Pairs of uniforms in a chunk."""

_KEPT_CHUNKS: Final = 4

Cells = NDArray[np.int64]
Draw = Callable[[int, int], tuple[Cells, NDArray[np.integer]]]


class RenewalPath:
    """``draw(number, before)`` returns the lengths (N,) >= 1 and the values (N,) of one chunk's stretches.

    ``before`` is the value of the last stretch of the chunk before it, 0 for the first. ``draw`` must be a function
    of its arguments alone; then the path is the same whatever was asked for before (oracle: one walk in order,
    test_outage).
    """

    def __init__(self, draw: Draw) -> None:
        self._draw = draw
        self._begins = [0]  # the first cell of each chunk that is known, and of the one after them
        self._befores = [0]
        self._chunks: dict[int, tuple[Cells, NDArray[np.integer]]] = {}
        self._held = Stretch(0, 0, 0)

    def at(self, cell: int) -> Stretch:
        """Return the stretch that ``cell`` >= 0 lies in; neighbours may have the same value."""
        held = self._held
        if not held.begin <= cell < held.end:
            held = self._held = self._find(cell)
        return held

    def prepare(self, cell: int) -> None:
        """Draw the chunk behind the one that ``cell`` lies in, so that it is there when it is wanted."""
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
            if len(self._chunks) >= _KEPT_CHUNKS:
                del self._chunks[next(iter(self._chunks))]
            self._chunks[number] = chunk
        return chunk


def geometric_cells(u: Floats, mean: Floats | float) -> Cells:
    """Return geometric lengths of at least one cell, shape of ``u``: the exponential distribution of a grid.

    P(L > k) = (1 - 1/mean)^k, so the mean is exact and the process has no memory. ``mean`` >= 1 is in cells; 1 makes
    every length 1. (Devroye, "Non-Uniform Random Variate Generation", 1986, chapter X.2.)
    """
    with np.errstate(divide="ignore"):
        lengths = np.ceil(np.log(u) / np.log1p(-1.0 / np.asarray(mean, np.float64)))
    return np.maximum(lengths, 1.0).astype(np.int64)
