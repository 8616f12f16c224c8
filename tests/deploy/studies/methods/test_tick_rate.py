"""The highest rate of ticks, against sequences written by hand and against every period tried in turn."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.deploy.studies.methods.steps import highest_rate_hz, misses_a_tick

STEPS = st.lists(st.integers(1, 300), min_size=2, max_size=30)


def test_equal_steps_of_1_ms_that_never_catch_up_need_almost_a_period_each() -> None:
    """Behind by s - T a tick, missed from T on: of three steps s = 1 ms two count, so 2 (s - T) < T, T > 2/3 ms."""
    assert highest_rate_hz([1_000_000] * 3) == pytest.approx(1500, rel=1e-5)
    assert highest_rate_hz([1_000_000] * 1001) == pytest.approx(1001, rel=1e-5)


def test_one_long_step_may_delay_the_next_tick_but_not_swallow_it() -> None:
    """A step of 10 ms among steps of nothing: with T = 5 ms the next begins at 10 ms, when another is due."""
    steps = [0, 10_000_000, 0, 0]
    assert misses_a_tick(steps, 5_000_000)
    assert not misses_a_tick(steps, 5_000_001)
    assert highest_rate_hz(steps) == pytest.approx(200, rel=1e-6)


def test_the_last_step_delays_nobody() -> None:
    assert not misses_a_tick([0, 10_000_000], 1)
    assert highest_rate_hz([5]) is None
    assert highest_rate_hz([]) is None


@given(STEPS)
def test_it_is_the_shortest_period_of_all_that_misses_none(steps: list[int]) -> None:
    rate_hz = highest_rate_hz(steps)
    assert rate_hz is not None
    period_ns = round(1e9 / rate_hz)
    shortest = next(period for period in range(1, max(steps) + 1) if not misses_a_tick(steps, period))
    assert period_ns == shortest


@given(STEPS, st.integers(1, 300))
def test_ticks_played_out_one_by_one_are_missed_as_stated(steps: list[int], period_ns: int) -> None:
    free_ns, missed = 0, False
    for k, step_ns in enumerate(steps):
        begun_ns = max(k * period_ns, free_ns)
        missed = missed or begun_ns >= (k + 1) * period_ns
        free_ns = begun_ns + step_ns
    assert misses_a_tick(steps, period_ns) == missed
