"""The ways to an observer: what is taken off a delay, and how far that can be wrong."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.clocks import Exchanges
from tis.deploy.watch.observer import ObserverPath, observer_path, vantage

AHEAD_NS = 7_000_000_000
LEGS = st.lists(st.tuples(st.integers(0, 10**8), st.integers(0, 10**8)), min_size=1, max_size=20)


def _exchanges(legs: list[tuple[int, int]]) -> Exchanges:
    """Exchanges whose ways there and back are known, with a clock that is ahead."""
    stamps = []
    for i, (there_ns, back_ns) in enumerate(legs):
        asked_ns = i * 10**9
        received_ns = asked_ns + there_ns + AHEAD_NS
        stamps.append((asked_ns, received_ns, received_ns + 5, asked_ns + there_ns + 5 + back_ns))
    return Exchanges.of(stamps)


def test_half_the_shortest_round_trip_and_what_the_longest_leaves_open() -> None:
    assert observer_path(_exchanges([(3_000_000, 5_000_000), (2_000_000, 4_000_000)])) == ObserverPath(
        3_000_000, 5_000_000
    )
    assert observer_path(_exchanges([(4_000_000, 4_000_000)])) == ObserverPath(4_000_000, 4_000_000)
    with pytest.raises(ValueError):
        observer_path(_exchanges([]))


@given(LEGS, LEGS, st.integers(0, 10**9))
def test_a_corrected_delay_is_off_by_no_more_than_is_said(
    west: list[tuple[int, int]], east: list[tuple[int, int]], delay_ns: int
) -> None:
    one, other = observer_path(_exchanges(west)), observer_path(_exchanges(east))
    bound_ms = vantage([one, other], False).bound_ms
    for _, to_west_ns in west:
        for _, to_east_ns in east:  # a message that took the very ways that the answers took
            seen_ns = (delay_ns + to_east_ns - other.ns) - (to_west_ns - one.ns)
            assert abs(seen_ns - delay_ns) <= bound_ms * 1e6 + 1e-3
