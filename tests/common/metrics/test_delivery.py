"""Which samples packets bring: against sets filled packet by packet."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.metrics.delivery import PlannedSamples, ages_at_ns
from tis.common.metrics.tick_phase import Arrivals


def test_two_copies_of_three_samples_by_hand() -> None:
    """The copy of each sample leaves after the next sample: packets hold 0, 10, 0, 20, 10, 20."""
    sample_ns = np.array([0, 10, 0, 20, 10, 20])
    planned = PlannedSamples.of(np.arange(6), sample_ns)
    assert planned.sample_ns.tolist() == [0, 10, 20]
    assert planned.is_first.tolist() == [True, True, False, True, False, False]
    second_of_10 = np.array([False, False, False, False, True, False])
    assert planned.carried(second_of_10, 0).tolist() == [False, True, False]
    assert planned.carried(second_of_10, 1).tolist() == [True, True, False]
    assert planned.carried(second_of_10, 9).tolist() == [True, True, False]


def test_of_nothing_nothing_arrives() -> None:
    nothing = np.empty(0, dtype=np.int64)
    planned = PlannedSamples.of(nothing, nothing)
    assert planned.carried(np.empty(0, dtype=np.bool_), 3).tolist() == []


def test_numbers_that_do_not_ascend_are_refused() -> None:
    with pytest.raises(ValueError, match="must ascend"):
        PlannedSamples.of(np.array([1, 1]), np.array([0, 0]))


@settings(max_examples=60)
@given(
    packets=st.lists(st.tuples(st.integers(0, 12), st.booleans()), max_size=30),
    history=st.integers(0, 14),
)
def test_it_is_the_set_of_what_each_packet_brings(packets: list[tuple[int, bool]], history: int) -> None:
    sample_ns = np.array([7 * k for k, _ in packets], dtype=np.int64)
    arrived = np.array([here for _, here in packets], dtype=np.bool_)
    planned = PlannedSamples.of(np.arange(len(packets)), sample_ns)
    taken = sorted({7 * k for k, _ in packets})
    brought: set[int] = set()
    for k, here in packets:
        place = taken.index(7 * k)
        brought |= set(taken[max(0, place - history) : place + 1]) if here else set()
    found = planned.carried(arrived, history)
    assert set(planned.sample_ns[found].tolist()) == brought
    assert int(planned.is_first.sum()) == len(taken)


@settings(max_examples=60)
@given(
    arrivals=st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=20),
    at=st.lists(st.integers(0, 60), max_size=8),
)
def test_an_age_is_that_of_the_freshest_of_all_that_came(arrivals: list[tuple[int, int]], at: list[int]) -> None:
    recv, sample = (np.array([one[i] for one in arrivals], dtype=np.int64) for i in (0, 1))
    found = ages_at_ns(*Arrivals.of(recv, sample), np.array(at, dtype=np.int64))
    for instant, age in zip(at, found.tolist(), strict=True):
        known = [s for r, s in arrivals if r <= instant]
        assert age == (instant - max(known) if known else -1)
