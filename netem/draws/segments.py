"""A path with memory, in blocks, with access in any order at bounded cost.

The state of a path at a packet depends on all earlier packets, but sequence numbers can be forged, up to 2**32, so
the walk to a packet must be bounded. The path is cut into segments of 16 blocks. Each segment is entered one block
before its first packet, in a state drawn from the stationary distribution; that block is a warm-up. So the
distribution at every packet is exactly the stationary one. Where the memory is shorter than the warm-up, the path
joins the one of the previous segment, which has the same uniforms: the cut leaves no trace.
"""

from collections.abc import Callable
from typing import Final, Generic, TypeVar

from tis.netem.draws.blocks import Floats

BLOCKS_PER_SEGMENT: Final = 16
_MAX_KEPT_STATES: Final = 64

S = TypeVar("S")


class SegmentedPath(Generic[S]):
    """A path that ``enter(segment)`` begins and ``walk(number, state)`` continues over block ``number``.

    ``walk`` returns the values of the block and the state after it, and must depend on its arguments alone.
    """

    def __init__(self, enter: Callable[[int], S], walk: Callable[[int, S], tuple[Floats, S]]) -> None:
        self._enter = enter
        self._walk = walk
        # (segment, block) -> state before that block, so that the next block in a row costs one walk
        self._states: dict[tuple[int, int], S] = {}

    def block(self, number: int) -> Floats:
        """Return block ``number`` >= 0, (BLOCK,): at most 17 walks, one when the previous block was returned last.

        Oracle: one walk through all blocks in order, tests/netem/draws/test_segments.
        """
        segment = number // BLOCKS_PER_SEGMENT
        at, state = self._nearest(segment, number)
        while True:
            values, state = self._walk(at, state)
            at += 1
            self._keep((segment, at), state)
            if at > number:
                return values

    def _nearest(self, segment: int, number: int) -> tuple[int, S]:
        first = max(0, segment * BLOCKS_PER_SEGMENT - 1)
        for at in range(number, first, -1):
            if (segment, at) in self._states:
                return at, self._states[segment, at]
        return first, self._enter(segment)

    def _keep(self, place: tuple[int, int], state: S) -> None:
        self._states.pop(place, None)
        self._states[place] = state
        if len(self._states) > _MAX_KEPT_STATES:
            del self._states[next(iter(self._states))]
