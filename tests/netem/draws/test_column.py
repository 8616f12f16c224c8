import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tis.netem.draws.blocks import BLOCK, Column


def _squares(number: int) -> np.ndarray:
    return (np.arange(number * BLOCK, (number + 1) * BLOCK, dtype=np.int64)) ** 2


@given(st.lists(st.integers(0, 20 * BLOCK), max_size=40))
def test_single_elements_are_those_of_many(indices: list[int]) -> None:
    column = Column(_squares)
    assert [column[i] for i in indices] == [i * i for i in indices]
    assert column.many(np.array(indices, dtype=np.int64)).tolist() == [i * i for i in indices]


def test_elements_are_python_numbers() -> None:
    assert type(Column(_squares)[3]) is int
    assert type(Column(lambda _: np.zeros(BLOCK, dtype=bool))[3]) is bool
    assert type(Column(lambda _: np.zeros(BLOCK))[3]) is float


def test_the_next_block_is_a_deferred_draw() -> None:
    drawn: list[int] = []

    def draw(number: int) -> np.ndarray:
        drawn.append(number)
        return _squares(number)

    deferred: list[object] = []
    column = Column(draw, deferred)  # type: ignore[arg-type]
    assert column[5] == 25
    assert drawn == [0]
    deferred.pop()()  # type: ignore[operator]
    assert drawn == [0, 1]
    assert column[BLOCK] == BLOCK**2
    assert drawn == [0, 1]  # nobody had to wait for it
    assert len(deferred) == 1


def test_few_blocks_are_kept() -> None:
    drawn: list[int] = []

    def draw(number: int) -> np.ndarray:
        drawn.append(number)
        return _squares(number)

    column = Column(draw)
    for index in (0, BLOCK, 0, BLOCK, 5 * BLOCK, 0):
        assert column[index] == index * index
    assert drawn == [0, 1, 5]
    for number in range(20):
        assert column[number * BLOCK] == (number * BLOCK) ** 2
    assert len(column._kept) <= 4


def test_a_stretch_is_many_in_a_row() -> None:
    column = Column(_squares)
    for first, n in ((0, 1), (5, 3), (BLOCK - 1, 2), (BLOCK - 7, 6 * BLOCK), (3 * BLOCK, BLOCK)):
        assert column.stretch(first, n).tolist() == column.many(np.arange(first, first + n)).tolist()
