from itertools import groupby, pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tis.common.metrics.loss_runs import loss_runs


def test_an_example_by_hand() -> None:
    #                        0  1  2  3  4  5  6  7  8
    runs = loss_runs(np.array([0, 1, 1, 0, 0, 1, 0, 1, 1], dtype=bool))
    assert (runs.n, runs.n_lost, runs.n_runs) == (9, 5, 3)
    assert runs.lengths.tolist() == [2, 1, 2]
    assert runs.distances.tolist() == [1, 3, 2, 1]
    assert runs.mean_burst == 5 / 3
    assert runs.longest == 2


def test_nothing_lost_nothing_sent_and_all_lost() -> None:
    for n in (0, 4):
        runs = loss_runs(np.zeros(n, dtype=bool))
        assert (runs.n, runs.n_lost, runs.n_runs, runs.mean_burst, runs.longest) == (n, 0, 0, None, 0)
        assert len(runs.distances) == 0
    runs = loss_runs(np.ones(4, dtype=bool))
    assert (runs.lengths.tolist(), runs.distances.tolist()) == ([4], [1, 1, 1])


@given(st.lists(st.booleans(), max_size=60))
def test_as_one_groups_by_hand(lost: list[bool]) -> None:
    runs = loss_runs(np.array(lost, dtype=bool))
    groups = [(key, len(list(group))) for key, group in groupby(lost)]
    assert runs.lengths.tolist() == [n for key, n in groups if key]
    assert runs.n_lost == sum(lost) == runs.lengths.sum()
    at = [i for i, one in enumerate(lost) if one]
    assert runs.distances.tolist() == [later - sooner for sooner, later in pairwise(at)]
