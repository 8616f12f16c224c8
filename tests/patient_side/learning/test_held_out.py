import numpy as np
import pytest

from tis.patient_side.learning.examples import Track
from tis.patient_side.learning.train import grouped, held_out, is_in

TRACKS = [Track(np.zeros((100, 3)), np.zeros(100), ""), Track(np.ones((50, 3)), np.ones(50), "")]


def test_people_are_groups_where_there_are_several() -> None:
    assert [track.group for track in grouped(TRACKS, ["D", "E"], ["a", "b"])] == ["D", "E"]


def test_trials_are_groups_of_one_person() -> None:
    assert [track.group for track in grouped(TRACKS, ["D", "D"], ["a", "b"])] == ["a", "b"]


def test_a_single_trial_is_cut_in_two() -> None:
    parts = grouped(TRACKS[:1], ["D"], ["a"])
    assert [(track.group, len(track.position_m)) for track in parts] == [("first rows", 70), ("last rows", 30)]


@pytest.mark.parametrize(
    ("n", "seed", "held"),
    [(1, 3, ()), (3, 0, ("A",)), (3, 1, ("B",)), (3, 3, ("A",)), (10, 0, ("A", "B")), (10, 4, ("I", "J"))],
)
def test_a_fifth_of_the_groups_is_held_out_by_turns(n: int, seed: int, held: tuple[str, ...]) -> None:
    assert held_out("ABCDEFGHIJ"[:n], seed) == held


def test_examples_belong_to_the_groups_of_their_numbers() -> None:
    assert is_in(np.array([0, 1, 2, 1]), ("D", "E", "F"), ("E",)).tolist() == [False, True, False, True]
