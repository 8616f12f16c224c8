import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tis.common.streams import BLOCK
from tis.netem.draws.blocks import Floats, SegmentedPath


class Counting:
    """A path whose block says which segment it was entered for and which blocks it went through since."""

    def __init__(self) -> None:
        self.n_walks = 0
        self.path = SegmentedPath(self.enter, self.walk)

    def enter(self, segment: int) -> tuple[int, ...]:
        return (-segment,)

    def walk(self, number: int, state: tuple[int, ...]) -> tuple[Floats, tuple[int, ...]]:
        self.n_walks += 1
        state = (*state, number)
        return np.resize(np.array(state, dtype=float), BLOCK), state

    def at(self, number: int) -> list[float]:
        segment = number // 16
        first = max(0, 16 * segment - 1)
        n = 2 + number - first
        assert n <= 18
        return [float(value) for value in self.path.block(number)[:n]]


def walked(number: int) -> list[float]:
    """From the segment's entry, one block before its first packet, to the block."""
    segment = number // 16
    return [float(-segment), *map(float, range(max(0, 16 * segment - 1), number + 1))]


@given(st.lists(st.integers(0, 2**20 - 1) | st.integers(0, 40), min_size=1, max_size=80))
def test_a_block_does_not_depend_on_those_asked_for_before(numbers: list[int]) -> None:
    counting = Counting()
    for number in numbers:
        assert counting.at(number) == walked(number)
    assert len(counting.path._states) <= 64


def test_blocks_in_order_cost_one_walk_and_a_jump_at_most_17() -> None:
    counting = Counting()
    for number in range(64):
        counting.at(number)
    assert counting.n_walks == 64 + 3  # a block of warming up in each of three segments
    counting.at(2**20 - 1)
    assert counting.n_walks == 64 + 3 + 17


def test_interleaved_stretches_do_not_begin_again() -> None:
    counting = Counting()
    for number in range(1, 8):
        counting.at(number)
        counting.at(number - 1)
    assert counting.n_walks <= 2 * 8
