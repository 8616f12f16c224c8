"""Which rows are held out together."""

import numpy as np

from tis.patient_side.identification.trials import held_out_groups


def test_people_are_held_out_where_there_are_several() -> None:
    groups = held_out_groups([3, 2, 4], ["B", "A", "B"])
    assert [each.tolist() for each in groups] == [[1, 1, 1], [0, 0], [1, 1, 1, 1]]


def test_many_people_share_six_groups() -> None:
    groups = held_out_groups([1] * 9, list("ABCDEFGHI"))
    found = [int(each[0]) for each in groups]
    assert found == sorted(found)
    assert set(found) == set(range(6))


def test_one_person_is_held_out_by_stretches() -> None:
    (one,) = held_out_groups([12], ["A"])
    assert one.tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
    first, second, third = held_out_groups([4, 4, 4], [])
    assert np.concatenate([first, second, third]).tolist() == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5]
    assert [each.tolist() for each in held_out_groups([0], [])] == [[]]
