import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tis.common.streams import BLOCK
from tis.netem.draws.blocks import HEAD, Column, DeferredDraw


def _squares(number: int, _: int = BLOCK) -> np.ndarray:
    return (np.arange(number * BLOCK, (number + 1) * BLOCK, dtype=np.int64)) ** 2


@given(st.lists(st.integers(0, 20 * BLOCK), max_size=40))
def test_single_elements_are_those_of_many(indices: list[int]) -> None:
    column = Column(_squares)
    assert [column[i] for i in indices] == [i * i for i in indices]
    assert column.many(np.array(indices, dtype=np.int64)).tolist() == [i * i for i in indices]


def test_elements_are_python_numbers() -> None:
    assert type(Column(_squares)[3]) is int
    assert type(Column(lambda *_: np.zeros(BLOCK, dtype=bool))[3]) is bool
    assert type(Column(lambda *_: np.zeros(BLOCK))[3]) is float


class _Draw:
    """Draws that are noted: the block, and how many of its elements."""

    def __init__(self) -> None:
        self.drawn: list[tuple[int, int]] = []

    def __call__(self, number: int, n: int) -> np.ndarray:
        self.drawn.append((number, n))
        return _squares(number)[:n]


def test_of_its_first_block_only_the_head_is_drawn_until_more_is_asked_for() -> None:
    draw, deferred = _Draw(), list[DeferredDraw]()
    column = Column(draw, deferred)
    assert [column[i] for i in range(HEAD)] == [i * i for i in range(HEAD)]
    assert draw.drawn == [(0, HEAD)]
    assert not deferred  # most names have no more packets
    assert column[HEAD] == HEAD**2
    assert column[3] == 9
    assert draw.drawn == [(0, HEAD), (0, BLOCK)]
    assert len(deferred) == 1


def test_of_a_block_that_comes_whole_only_the_head_is_kept() -> None:
    column = Column(_squares)
    assert column[0] == 0
    assert column._block.nbytes == 8 * HEAD
    assert np.asarray(column._block).base is None or not column._kept


def test_the_next_block_is_a_deferred_draw() -> None:
    draw, deferred = _Draw(), list[DeferredDraw]()
    column = Column(draw, deferred)
    assert column[HEAD] == HEAD**2
    assert column[BLOCK - 1] == (BLOCK - 1) ** 2
    assert not deferred  # it is not known yet that the name stays
    assert column[BLOCK] == BLOCK**2
    deferred.pop()()
    assert column[2 * BLOCK] == 4 * BLOCK**2
    assert draw.drawn == [(0, BLOCK), (1, BLOCK), (2, BLOCK)]  # nobody had to wait for the last one
    assert len(deferred) == 1


def test_few_blocks_are_kept() -> None:
    draw = _Draw()
    column = Column(draw)
    for index in (0, BLOCK, 0, BLOCK, 5 * BLOCK, 0):
        assert column[index] == index * index
    assert draw.drawn == [(0, HEAD), (1, BLOCK), (0, BLOCK), (5, BLOCK)]
    for number in range(20):
        assert column[number * BLOCK] == (number * BLOCK) ** 2
    assert len(column._kept) <= 4


def test_a_stretch_is_many_in_a_row() -> None:
    column = Column(_squares)
    for first, n in ((0, 1), (5, 3), (BLOCK - 1, 2), (BLOCK - 7, 6 * BLOCK), (3 * BLOCK, BLOCK)):
        assert column.stretch(first, n).tolist() == column.many(np.arange(first, first + n)).tolist()
