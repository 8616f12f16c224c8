import math
import random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.playout import Playout, SourceBuffer


def position(value: float) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return np.full(3, value)


def test_sample_instants_become_indices() -> None:
    playout = Playout(30)
    assert [playout.index(t) for t in (0, 33_333_333, 33_333_334, 66_666_666, 999_999_999)] == [0, 1, 1, 2, 30]


def test_age_counts_fractions_of_a_sample() -> None:
    playout = Playout(30)
    assert playout.age_samples(3, 100_000_000) == 0.0
    assert playout.age_samples(3, 150_000_000) == 1.5
    assert playout.age_samples(0, 2_000_000) == 0.06


def test_duplicates_negative_and_stale_indices_are_refused() -> None:
    buffer = SourceBuffer(depth=4)
    assert buffer.add(10, position(1.0))
    assert not buffer.add(10, position(2.0))
    assert not buffer.add(-1, position(2.0))
    assert buffer.add(7, position(3.0))
    assert not buffer.add(6, position(4.0))
    kept = buffer.get(10)
    assert kept is not None
    assert kept[0] == 1.0


def test_nothing_has_arrived() -> None:
    buffer = SourceBuffer(depth=4)
    assert (buffer.newest, buffer.newest_before(100), buffer.oldest_after(-1)) == (-1, -1, -1)
    assert buffer.last_arrived == -1
    assert buffer.get(buffer.newest) is None


@given(st.lists(st.integers(0, 60), max_size=60), st.integers(1, 20), st.integers(-2, 62))
@settings(max_examples=200, deadline=None)
def test_buffer_is_a_list_of_the_newest_indices(arrivals: list[int], depth: int, index: int) -> None:
    buffer, kept, last = SourceBuffer(depth), list[int](), -1
    for i in arrivals:
        taken = i not in kept and i > max(kept, default=-1) - depth
        assert buffer.add(i, position(i)) == taken
        if taken:
            kept, last = [j for j in [*kept, i] if j > max([*kept, i]) - depth], i
        assert buffer.last_arrived == last
        assert (buffer.get(last) is not None) == (last >= 0)
    assert buffer.newest == max(kept, default=-1)
    assert buffer.newest_before(index) == max((j for j in kept if j < index), default=-1)
    assert buffer.oldest_after(index) == min((j for j in kept if j > index), default=-1)
    assert buffer.after(index) == sorted(j for j in kept if j > index)
    assert (buffer.get(index) is None) == (index not in kept)


def test_the_last_arrival_counts_even_when_it_is_old_but_not_when_it_is_refused() -> None:
    buffer = SourceBuffer(depth=4)
    last = []
    for index in (10, 8, 10, 6, 11, 7, 12):
        buffer.add(index, position(index))
        last.append(buffer.last_arrived)
    assert last == [10, 8, 8, 8, 11, 11, 12]


def test_beside_a_position_lies_the_grippers_angle() -> None:
    buffer = SourceBuffer(depth=4)
    assert buffer.gripper_rad(5) is None
    buffer.add(3, position(3.0), 0.3)
    buffer.add(5, position(5.0))
    buffer.add(6, position(6.0), 0.6)
    assert [buffer.gripper_rad(i) for i in (2, 3, 4, 6, 9)] == [None, 0.3, 0.3, 0.6, 0.6]
    assert buffer.gripper_rad(5) == 0.3  # a sample without one
    buffer.add(8, position(8.0), 0.8)
    assert buffer.gripper_rad(4) is None  # 3 has gone


def test_orientations_are_kept_by_index_and_go_with_their_samples() -> None:
    buffer = SourceBuffer(4)
    turns = np.eye(4)
    for index in (0, 2, 1, 3):
        assert buffer.add(index, np.zeros(3), 0.1 * index, turns[index])
    assert not buffer.add(2, np.ones(3), 9.0, turns[0])  # a copy changes nothing
    assert [buffer.orientation(i) is not None for i in range(-1, 5)] == [False, True, True, True, True, False]
    assert buffer.orientation(2) is not None
    assert np.array_equal(buffer.orientation(2), turns[2])  # type: ignore[arg-type]
    assert buffer.wrists(np.array([2])).tolist() == [[*turns[2], 0.2]]
    buffer.add(6, np.zeros(3), None, None)  # 0 to 2 are stale now
    assert [buffer.orientation(i) is not None for i in range(7)] == [False, False, False, True, False, False, False]
    assert buffer.gripper_rad(6) == 0.1 * 3  # that of the sample before
    assert buffer.arrived(np.array([6, 5, 3, 2])).tolist() == [True, False, True, False]
    assert buffer.all_arrived(np.array([6, 3]))
    assert not buffer.all_arrived(np.array([6, 5]))
    assert not buffer.all_arrived(np.array([3, 2]))


@given(
    st.lists(st.floats(-0.49, 0.49), min_size=8, max_size=20),
    st.lists(st.booleans(), min_size=20, max_size=20),
    st.lists(st.floats(-1, 1), min_size=5, max_size=5),
    st.randoms(use_true_random=False),
)
@settings(max_examples=100, deadline=None)
def test_uneven_samples_of_a_polynomial_are_stated_exactly_at_the_plans_instants(
    lates: list[float], turned: list[bool], shares: list[float], order: random.Random
) -> None:
    """Any five samples tell a quartic, in whatever order they came; a quaternion's sign tells nothing."""
    buffer, places = SourceBuffer(64), list(range(len(lates)))
    order.shuffle(places)
    for i in places:
        turn = np.array([0.0, 0.0, math.sin(0.3), math.cos(0.3)]) * (-1 if turned[i] else 1)
        at = position(polynomial(shares, i + lates[i]))
        assert buffer.add(i, at, polynomial(shares, i + lates[i]), turn, lates[i])
        assert not buffer.add(i, position(9.0), late=0.1)
        assert np.array_equal(buffer.taken(i).position_m, at)
    for i, late in enumerate(lates):
        for instant, found in ((i, buffer.get(i)), (i + 0.3, buffer.at(i, 0.3)), (i + late, buffer.at(i, late))):
            assert found is not None
            assert found == pytest.approx(position(polynomial(shares, instant)), abs=1e-8)
        assert buffer.gripper_rad(i) == pytest.approx(polynomial(shares, i), abs=1e-8)
        turn_now = buffer.orientation(i)
        assert turn_now is not None
        assert np.abs(turn_now) == pytest.approx([0.0, 0.0, math.sin(0.3), math.cos(0.3)])


def polynomial(shares: list[float], instant: float) -> float:
    return sum(share * (instant / 10) ** power for power, share in enumerate(shares))


def test_a_sample_alone_or_across_a_long_gap_is_stated_as_it_was_sent() -> None:
    buffer = SourceBuffer(64)
    buffer.add(3, position(1.0), late=0.4)
    buffer.add(30, position(2.0), late=-0.4)
    assert [buffer.get(3), buffer.get(30)] == [pytest.approx(position(1.0)), pytest.approx(position(2.0))]
    assert buffer.uneven
