from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.phase_lock import WINDOW, PhaseLock, Shift

MS = 1_000_000
PHASE = 2 * MS


def lock(delays_ms: list[float]) -> PhaseLock:
    found = PhaseLock(30)
    for i, delay_ms in enumerate(delays_ms):
        sample_ns = i * 10**9 // 30
        found.note("left", sample_ns + round(delay_ms * MS), sample_ns)
    return found


def test_it_decides_once_a_second_and_not_before_it_has_seen_enough() -> None:
    assert lock([10.0] * 15).decide(29, PHASE) is None
    seen = lock([10.0] * 16)
    assert [k for k in range(91) if seen.decide(k, PHASE)] == [29, 59, 89]
    assert PhaseLock(30).decide(29, PHASE) is None


def test_a_look_is_not_lost_with_a_tick_that_was_missed() -> None:
    seen = lock([10.0] * 16)
    assert [k for k in range(91) if k not in (29, 30, 59) and seen.decide(k, PHASE)] == [31, 60, 89]


def test_once_it_lies_well_it_stays() -> None:
    seen = lock([10.0] * 40)
    shift = seen.decide(29, PHASE)
    assert shift is not None
    assert 10 * MS < shift.phase_ns < 10.5 * MS
    assert seen.decide(59, shift.phase_ns) is None


def test_a_delay_that_varies_by_more_than_a_period_moves_nothing() -> None:
    """The present phase is as good as any: what looks better over a window is chance."""
    delays = [20 + 40 * ((i * 0.618034) % 1) for i in range(128)]
    assert lock(delays).decide(29, PHASE) is None


def test_all_hands_count() -> None:
    seen = lock([10.0] * 40)
    for i in range(40):
        seen.note("right", i * 10**9 // 30 + 20 * MS, i * 10**9 // 30)
    shift = seen.decide(29, PHASE)
    assert shift is not None
    assert 20 * MS < shift.phase_ns < 20.5 * MS  # just behind the later one: both arrive before


def test_only_the_last_arrivals_are_remembered() -> None:
    seen = lock([10.0] * 300 + [15.0] * WINDOW)
    shift = seen.decide(29, PHASE)
    assert shift is not None
    assert 15 * MS < shift.phase_ns < 15.5 * MS


@settings(deadline=None, max_examples=30)
@given(st.lists(st.floats(0, 90), min_size=16, max_size=60), st.integers(0, 33_333_332))
def test_a_shift_is_within_a_period_and_gains(delays_ms: list[float], phase_ns: int) -> None:
    seen = PhaseLock(30)
    newest = -1
    for recv, sample in sorted((i * 10**9 // 30 + round(d * MS), i * 10**9 // 30) for i, d in enumerate(delays_ms)):
        if sample > newest:
            seen.note("left", recv, sample)
            newest = sample
    shift = seen.decide(29, phase_ns)
    assert shift is None or isinstance(shift, Shift)
    if shift is not None:
        assert 0 <= shift.phase_ns < 33_333_334
        assert shift.age_before_ns - shift.age_ns > 0.02 * 10**9 / 30
