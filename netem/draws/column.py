"""An endless column of numbers, drawn in blocks: single elements for the live path, arrays for statistics."""

from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tis.netem.draws.blocks import BLOCK

_MAX_KEPT: Final = 4  # so that packets about the edge of two blocks, and duplicates, do not redraw
_SHIFT: Final = BLOCK.bit_length() - 1
_MASK: Final = BLOCK - 1

DeferredDraw = Callable[[], None]
"""A draw that can wait for an idle moment."""


class Column:
    """Element i is element ``i % BLOCK`` of ``draw(i // BLOCK)``, in any order of access.

    The first access to a block appends the draw of the next block to ``deferred``: it is made in an idle moment, so
    that no packet waits for it.
    """

    def __init__(self, draw: Callable[[int], NDArray[Any]], deferred: list[DeferredDraw] | None = None) -> None:
        self._draw = draw
        self._deferred = deferred
        self._kept: dict[int, memoryview] = {}
        self._number = -1
        self._block = memoryview(b"")

    def __getitem__(self, index: int) -> Any:
        """Return one element as a Python number (oracle: `many`)."""
        number = index >> _SHIFT
        if number != self._number:
            self._block, self._number = self._fetch(number), number
            if self._deferred is not None:
                self._deferred.append(lambda: self.prepare(number + 1))
        return self._block[index & _MASK]

    def stretch(self, first: int, n: int) -> NDArray[Any]:
        """Return elements ``first`` .. ``first + n - 1``, n >= 1 (oracle: `many`)."""
        numbers = range(first >> _SHIFT, (first + n - 1 >> _SHIFT) + 1)
        blocks = np.concatenate([np.asarray(self._fetch(number)) for number in numbers])
        at = first & _MASK
        return blocks[at : at + n]

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
            # a memoryview yields a Python number three times faster than an array, at a quarter of a list's memory
            block = np.ascontiguousarray(self._draw(number)).data
            if len(self._kept) >= _MAX_KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[number] = block
        return block
