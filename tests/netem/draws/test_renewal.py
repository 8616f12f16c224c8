import numpy as np
import pytest
from scipy.stats import chisquare

from tis.common.streams import Stream
from tis.netem.draws.grid import Cells, RenewalPath, Stretch, geometric_cells


def _three_a_chunk(number: int, before: int) -> tuple[Cells, Cells]:
    return np.array([1, 2, number + 1]), np.array([before + 1, before + 2, before + 3])


@pytest.mark.parametrize("order", [[0, 1, 2, 3, 4, 5, 6, 7, 8], [8, 0, 7, 3, 5, 1, 2, 6, 4]])
def test_stretches_follow_each_other_whatever_was_asked_before(order: list[int]) -> None:
    expected = {
        0: Stretch(0, 1, 1), 1: Stretch(1, 3, 2), 2: Stretch(1, 3, 2), 3: Stretch(3, 4, 3),
        4: Stretch(4, 5, 4), 5: Stretch(5, 7, 5), 6: Stretch(5, 7, 5), 7: Stretch(7, 9, 6), 8: Stretch(7, 9, 6),
    }  # fmt: skip
    path = RenewalPath(_three_a_chunk)
    assert {cell: path.at(cell) for cell in order} == expected


def test_little_is_kept_of_what_lies_behind() -> None:
    drawn: list[int] = []

    def draw(number: int, before: int) -> tuple[Cells, Cells]:
        drawn.append(number)
        return np.full(4096, 10), np.zeros(4096, np.int64)

    path = RenewalPath(draw)
    path.at(40_960 * 100)
    assert drawn == list(range(101))
    assert len(path._chunks) <= 4
    assert path.at(40_960 * 7 + 25) == Stretch(40_960 * 7 + 20, 40_960 * 7 + 30, 0)
    assert drawn[101:] == [7]
    path.prepare(40_960 * 101)
    assert drawn[102:] == [101, 102]
    path.prepare(40_960 * 101 + 5)
    path.at(40_960 * 102)
    assert drawn[104:] == []


def test_geometric_lengths() -> None:
    u = Stream.named(1, "test").uniforms(0, 200_000)
    lengths = geometric_cells(u, 3.5)
    p = 1 / 3.5
    expected = np.array([p * (1 - p) ** k for k in range(14)] + [(1 - p) ** 14]) * len(u)
    observed = np.bincount(np.minimum(lengths, 15), minlength=16)[1:]
    assert chisquare(observed, expected).pvalue > 0.001
    assert lengths.mean() == pytest.approx(3.5, rel=0.01)


def test_geometric_lengths_at_the_ends() -> None:
    ends = np.array([2.0**-54, 0.5, 1 - 2.0**-53])
    assert geometric_cells(ends, 1.0).tolist() == [1, 1, 1]
    assert geometric_cells(ends, np.array([2.0, 2.0, 2.0])).tolist() == [54, 1, 1]
    assert geometric_cells(ends, 86_400_000.0)[0] == pytest.approx(54 * np.log(2) * 86_400_000, rel=1e-6)
