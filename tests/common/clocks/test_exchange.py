import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.common.clocks.wrong_clock import MS, S, WrongClock, exchange
from tis.common.clocks import Exchanges, shortest

SECONDS = st.integers(-(10**6), 10**6)
WAYS = st.integers(0, 2 * S)


def test_the_four_timestamps_of_rfc_5905() -> None:
    """Worked on paper: asked at 100, the reference is 1000 ahead, 30 there, 7 to answer, 50 back."""
    found = Exchanges.of([(100, 1130, 1137, 187)])
    assert found.round_trip_ns.tolist() == [80]
    assert found.offset_ns.tolist() == [990]  # 10 off: half of what the ways differ by
    assert found.bound_ns.tolist() == [40]


@given(SECONDS, WAYS, st.integers(0, S), WAYS)
@settings(max_examples=200)
def test_the_true_offset_lies_within_the_bound_however_asymmetric_the_ways(
    ahead_s: int, there_ns: int, made_ns: int, back_ns: int
) -> None:
    ahead_ns = ahead_s * S + 1
    found = Exchanges.of([(0, ahead_ns + there_ns, ahead_ns + there_ns + made_ns, there_ns + made_ns + back_ns)])
    assert found.round_trip_ns.tolist() == [there_ns + back_ns]
    assert abs(int(found.offset_ns[0]) - ahead_ns) <= int(found.bound_ns[0])


@pytest.mark.parametrize(("there_ns", "back_ns"), [(80, 0), (0, 80), (81, 0), (0, 81)])
def test_the_bound_is_met_when_one_way_takes_all_the_time(there_ns: int, back_ns: int) -> None:
    found = Exchanges.of([(0, there_ns, there_ns, there_ns + back_ns)])
    assert abs(int(found.offset_ns[0])) in (int(found.bound_ns[0]), int(found.bound_ns[0]) - 1)
    assert int(found.bound_ns[0]) == (80 + 1) // 2 + (there_ns + back_ns) % 2


def test_what_no_clocks_can_have_stamped_is_left_out_and_the_rest_is_put_in_order() -> None:
    answered_before_asked = (500, 500, 500, 499)
    replied_before_received = (500, 500, 499, 600)
    made_longer_than_it_took = (500, 500, 601, 600)
    later, sooner = (20, 25, 25, 30), (0, 5, 5, 10)
    found = Exchanges.of([later, answered_before_asked, replied_before_received, made_longer_than_it_took, sooner])
    assert found.asked_ns.tolist() == [0, 20]
    assert len(Exchanges.of([])) == 0


def test_a_drift_during_the_exchange_stays_within_the_bound() -> None:
    """With 50 ppm and ways of seconds the offset itself moves; each stamp still binds it at its own instant."""
    clock = WrongClock()
    stamps = exchange(clock.shows, 10 * S, 2 * S, 0, 1 * S)
    asked_ns, received_ns, replied_ns, answered_ns = stamps
    then_ns, now_ns = (int(ns) for ns in (10 * S, 13 * S))
    assert then_ns - asked_ns <= received_ns - asked_ns
    assert now_ns - answered_ns >= replied_ns - answered_ns


@given(
    st.lists(st.tuples(st.integers(0, 50 * MS), st.integers(0, MS)), min_size=1, max_size=40), st.integers(1, 9 * MS)
)
@settings(max_examples=60)
def test_the_shortest_of_each_window(ways: list[tuple[int, int]], window_ns: int) -> None:
    """Against a dictionary of windows."""
    found = Exchanges.of([(asked_ns, 0, 0, asked_ns + trip_ns) for asked_ns, trip_ns in ways])
    expected: dict[int, tuple[int, int]] = {}
    for asked_ns, trip_ns in sorted(ways, key=lambda way: way[0]):
        window = (asked_ns - min(way[0] for way in ways)) // window_ns
        if window not in expected or trip_ns < expected[window][1]:
            expected[window] = (asked_ns, trip_ns)
    kept = shortest(found, window_ns)
    assert list(zip(kept.asked_ns.tolist(), kept.round_trip_ns.tolist(), strict=True)) == list(expected.values())


def test_of_no_exchange_none_is_the_shortest() -> None:
    assert len(shortest(Exchanges.of([]), S)) == 0
    assert np.array_equal(shortest(Exchanges.of([(0, 0, 0, 1)]), S).asked_ns, [0])
