"""Draws in blocks: the live path picks single numbers from the same arrays that the vectorised path returns.

A `Column` holds draws that do not depend on each other, a `SegmentedPath` those with a memory; either gives access in
any order at bounded cost.
"""

from collections.abc import Callable
from typing import Any, Final, Generic, Literal, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from tis.common.streams import BLOCK, Address

HEAD: Final = 64
"""The draws of a name's first packets: most names have no more, and a whole block takes 32 kB."""

Counts = Literal["packet", "cell"]
"""The unit of an index into the blocks: a packet of a key, or a cell of 1 ms of run time."""

Floats = NDArray[np.float64]


Drawn = TypeVar("Drawn", covariant=True)
_MAX_KEPT: Final = 4  # so that packets about the edge of two blocks, and duplicates, do not redraw
_SHIFT: Final = BLOCK.bit_length() - 1
_MASK: Final = BLOCK - 1
BLOCKS_PER_SEGMENT: Final = 16
_MAX_KEPT_STATES: Final = 64
S = TypeVar("S")


class Blocks(Protocol[Drawn]):
    """The draws of one key's packets, or of the cells of run time."""

    @property
    def counts(self) -> Counts:
        """Return the unit of an index."""
        ...

    def block(self, number: int, n: int = BLOCK) -> Drawn:
        """Return the first ``n`` draws of block ``number`` >= 0, or all, which do not depend on earlier calls."""
        ...


DelayBlocks = Blocks[NDArray[np.int64]]
"""Delays in ns, none negative."""

LossBlocks = Blocks[Floats]
"""The loss probability of each packet, 0 and 1 included, given the path of the model's state."""


class SelectionBlocks:
    """Packets selected independently: ``seq`` is one if element ``seq`` of the stage's stream is below ``p``.

    The packets that a smaller probability selects are among those of a greater one.
    """

    def __init__(self, address: Address, stage: str, p: float) -> None:
        self._p = p
        self._stream = address.stream(stage)

    def block(self, number: int, n: int = BLOCK) -> NDArray[np.bool_]:
        """Return which of the first ``n`` packets of block ``number`` >= 0 are selected, (n,).

        Oracle: the binomial distribution of their number, tests/netem/stages/test_duplication.
        """
        if self._p == 0.0:
            return np.zeros(n, dtype=np.bool_)
        return np.asarray(self._stream.block(number, n) < self._p)


DeferredDraw = Callable[[], None]
"""A draw that can wait for an idle moment."""


class Column:
    """Element i is element ``i % BLOCK`` of ``draw(i // BLOCK, BLOCK)``, in any order of access.

    ``draw(number, n)`` returns the first n elements of a block, or more. Of its first block a column keeps the first
    `HEAD` elements until another one is asked for. From then on the first access to a block appends the draw of the
    next one to ``deferred``: it is made in an idle moment, so that no packet waits for it.
    """

    def __init__(self, draw: Callable[[int, int], NDArray[Any]], deferred: list[DeferredDraw] | None = None) -> None:
        self._draw = draw
        self._deferred = deferred
        self._kept: dict[int, memoryview] = {}
        self._number = -1
        self._block = memoryview(b"")

    def __getitem__(self, index: int) -> Any:
        """Return one element as a Python number (oracle: `many`)."""
        number = index >> _SHIFT
        if number != self._number:
            self._select(number, index & _MASK)
        try:
            return self._block[index & _MASK]
        except IndexError:  # beyond the head
            self._go_to(number)
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
            return self._draw(0, 1)[:0]
        blocks = [self._draw(int(number), BLOCK) for number in numbers]
        found: NDArray[Any] = np.stack(blocks)[which, indices & _MASK]
        return found

    def _select(self, number: int, offset: int) -> None:
        """Make an element of another block accessible."""
        if self._number >= 0:
            self._go_to(number)
        elif offset < HEAD:
            # a copy, as the rest is not worth its memory
            self._block, self._number = np.array(self._draw(number, HEAD)[:HEAD]).data, number
        else:
            self._block, self._number = self._fetch(number), number

    def _go_to(self, number: int) -> None:
        """Go to a whole block, and have the next one drawn."""
        self._block, self._number = self._fetch(number), number
        if self._deferred is not None:
            self._deferred.append(lambda: self.prepare(number + 1))

    def _fetch(self, number: int) -> memoryview:
        block = self._kept.get(number)
        if block is None:
            # a memoryview yields a Python number three times faster than an array, at a quarter of a list's memory
            block = np.ascontiguousarray(self._draw(number, BLOCK)).data
            if len(self._kept) >= _MAX_KEPT:
                del self._kept[next(iter(self._kept))]
            self._kept[number] = block
        return block


class SegmentedPath(Generic[S]):
    """A path over packets that ``enter(segment)`` begins and ``walk(number, state)`` continues over block ``number``.

    ``walk`` returns the values of the block and the state after it, and must depend on its arguments alone.

    The state at a packet depends on all earlier packets, but sequence numbers can be forged, up to 2**32, so the walk
    to a packet must be bounded. The path is cut into segments of 16 blocks. Each segment is entered one block before
    its first packet, in a state drawn from the stationary distribution; that block is a warm-up. So the distribution
    at every packet is exactly the stationary one. Where the memory is shorter than the warm-up, the path joins the
    one of the previous segment, which has the same uniforms: the cut leaves no trace.
    """

    counts: Literal["packet"] = "packet"

    def __init__(self, enter: Callable[[int], S], walk: Callable[[int, S], tuple[Floats, S]]) -> None:
        self._begin = enter
        self._go_on = walk
        # (segment, block) -> state before that block, so that the next block in a row costs one walk
        self._states: dict[tuple[int, int], S] = {}

    def block(self, number: int, n: int = BLOCK) -> Floats:  # noqa: ARG002 - a walk costs the same
        """Return block ``number`` >= 0, (BLOCK,): at most 17 walks, one when the previous block was returned last.

        Oracle: one walk through all blocks in order, tests/netem/draws/test_segments.
        """
        segment = number // BLOCKS_PER_SEGMENT
        at, state = self._nearest(segment, number)
        while True:
            values, state = self._go_on(at, state)
            at += 1
            self._keep((segment, at), state)
            if at > number:
                return values

    def _nearest(self, segment: int, number: int) -> tuple[int, S]:
        first = max(0, segment * BLOCKS_PER_SEGMENT - 1)
        for at in range(number, first, -1):
            if (segment, at) in self._states:
                return at, self._states[segment, at]
        return first, self._begin(segment)

    def _keep(self, place: tuple[int, int], state: S) -> None:
        self._states.pop(place, None)
        self._states[place] = state
        if len(self._states) > _MAX_KEPT_STATES:
            del self._states[next(iter(self._states))]
