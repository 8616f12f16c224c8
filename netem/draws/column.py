"""A column of numbers without end, drawn in blocks: single ones for the live path, many at once for statistics."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from netem.draws.blocks import BLOCK

_KEPT: Final = 4  # packets that straddle an edge of blocks, or are duplicates, do not redraw
_SHIFT: Final = BLOCK.bit_length() - 1
_MASK: Final = BLOCK - 1

DeferredDraw = Callable[[], None]
"""A draw that can wait for an idle moment."""


class Column:
    """Element i is element ``i % BLOCK`` of ``draw(i // BLOCK)``, whoever asks and in whatever order.

    Whenever a new block is begun, the one behind it is put on ``deferred``: drawing it can wait for an idle moment,
    and then no packet waits for it.
    """

    def __init__(self, draw: Callable[[int], NDArray[Any]], deferred: list[DeferredDraw] | None = None) -> None:
        self._draw = draw
        self._deferred = deferred
        self._kept: dict[int, memoryview] = {}
        self._number = -1
        self._block = memoryview(b"")

    def __getitem__(self, index: int) -> Any:
        """Return one element, as a Python number (oracle: `many`)."""
        number = index >> _SHIFT
        if number != self._number:
            self._block, self._number = self._fetch(number), number
            if self._deferred is not None:
                self._deferred.append(lambda: self.prepare(number + 1))
        return self._block[index & _MASK]

    def prepare(self, number: int) -> None:
        """Draw a block ahead of its first use."""
        self._fetch(number)

    def many(self, indices: NDArray[np.int64]) -> NDArray[Any]:
        """Return the elements at ``indices`` (N,), each >= 0, in any order."""
        numbers, which = np.unique(indices >> _SHIFT, return_inverse=True)
        if len(numbers) == 0:
            return self._draw(0)[:0]
        found: NDArray[Any] = np.stack([self._draw(int(number)) for number in numbers])[which, indices & _MASK]
        return found

    def _fetch(self, number: int) -> memoryview:
        block = self._kept.get(number)
        if block is None:
            # a view gives up a Python number three times faster than the array does, at a quarter of a list's memory
            block = np.ascontiguousarray(self._draw(number)).data
            if len(self._kept) >= _KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[number] = block
        return block
