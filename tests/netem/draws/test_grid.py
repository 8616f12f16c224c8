from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.netem.draws.grid import LAST_CELL, cell_of, deciding_ns, mean_cells, nearest_cell

MS = 1_000_000


@pytest.mark.parametrize(
    ("instant_ns", "cell"), [(0, 0), (499_999, 0), (500_000, 1), (1_499_999, 1), (1_500_000, 2), (-1, 0)]
)
def test_edges_move_to_the_nearest_cell(instant_ns: int, cell: int) -> None:
    assert nearest_cell(instant_ns) == cell


def test_cells() -> None:
    assert [cell_of(ns) for ns in (-5 * MS, 0, MS - 1, MS, 2 * MS + 1)] == [0, 0, 0, 1, 2]
    assert LAST_CELL * MS < 2**63


@given(st.integers(0, 10**12), st.integers(0, 10**6))
def test_an_edge_is_behind_the_deciding_instant_when_its_cell_has_begun(instant_ns: int, cell: int) -> None:
    assert (instant_ns <= deciding_ns(cell)) == (nearest_cell(instant_ns) <= cell)


@given(st.integers(0, 5 * MS), st.integers(MS, 5 * MS), st.integers(1, 5_000).map(lambda k: k * 1000))
def test_mean_length_is_that_of_all_phases_counted(begin_ns: int, length_ns: int, every_ns: int) -> None:
    starts = [
        begin_ns + k * every_ns for k in range(1000)
    ]  # every 1 us: the phases come again after 1000 at the latest
    counted = sum(nearest_cell(start + length_ns) - nearest_cell(start) for start in starts)
    assert mean_cells(begin_ns, length_ns, every_ns) == pytest.approx(float(Fraction(counted, 1000)), abs=1e-12)
