import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.common.clocks.wrong_clock import MS, S, WrongClock, exchanges
from tis.common.clocks import Exchanges, read_clock


def test_an_old_exchange_loses_to_a_longer_new_one_by_what_a_drift_can_have_done() -> None:
    """10 us old by 1 s may be off by 5 + 100 us; a new one of 200 us by 100 us."""
    old, new = (0, 5_000, 5_000, 10_000), (S, S + 100_000, S + 100_000, S + 200_000)
    assert read_clock(Exchanges.of([old, new]), S + 200_000) == (0, 100_000)
    assert read_clock(Exchanges.of([old]), 500 * MS + 10_000) == (0, 5_000 + 50_000)


@given(st.floats(-99, 99), st.floats(0, 1), st.integers(0, 2**32))
@settings(max_examples=50, deadline=None)
def test_the_offset_now_lies_within_the_bound(drift_ppm: float, asymmetry: float, seed: int) -> None:
    clock = WrongClock(3 * S, drift_ppm)
    known = exchanges(clock.shows, 24, S // 4, 100_000, seed, asymmetry)
    now_ns = 12 * S
    own_ns = int(clock.shows([now_ns])[0])
    reading = read_clock(known, own_ns)
    assert abs(now_ns - own_ns - reading.offset_ns) <= reading.bound_ns + 1


def test_without_an_exchange_there_is_no_offset() -> None:
    with pytest.raises(ValueError, match="never compared"):
        read_clock(Exchanges.of([]), 0)
