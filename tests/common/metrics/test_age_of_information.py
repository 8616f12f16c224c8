import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.metrics.age_of_information import (
    Arrivals,
    Ints,
    age_of_information,
    ages_at_ticks_ns,
    ages_when_used_ns,
    best_phase,
    instant_ns,
    offset_ns,
)

MS = 1_000_000
PERIOD = 33_333_333


def ns(*values: int) -> Ints:
    return np.array(values, dtype=np.int64)


def constant(delay_ms: float, n: int = 90, rate_hz: int = 30) -> Arrivals:
    sample_ns = instant_ns(np.arange(n), rate_hz)
    return Arrivals(sample_ns + round(delay_ms * MS), sample_ns)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), max_size=20))
def test_only_fresher_samples_count(pairs: list[tuple[int, int]]) -> None:
    found = Arrivals.of(*np.array(pairs, dtype=np.int64).reshape(-1, 2).T)
    expected: list[tuple[int, int]] = []
    for recv, sample in sorted(pairs):
        if not expected or sample > expected[-1][1]:
            expected.append((recv, sample))
    assert list(zip(found.recv_ns.tolist(), found.sample_ns.tolist(), strict=True)) == expected


def test_offsets_are_counted_from_the_rounded_sample_instants() -> None:
    at = ns(0, 1, 33_333_332, 33_333_333, 66_666_665, 66_666_666, 100_000_000)
    assert offset_ns(at, 30).tolist() == [0, 1, 33_333_332, 0, 33_333_332, 0, 0]


@settings(deadline=None, max_examples=40)
@given(
    st.lists(st.integers(0, 90 * MS), min_size=2, max_size=30),
    st.integers(0, PERIOD - 1),
    st.sampled_from([30, 7, 1000]),
)
def test_ages_are_those_of_a_loop_over_ticks(delays: list[int], phase: int, rate_hz: int) -> None:
    phase %= 10**9 // rate_hz
    sample = instant_ns(np.arange(len(delays)), rate_hz)
    arrivals = Arrivals.of(sample + np.array(delays), sample)
    used = {}
    for k in range(5000):
        tick = k * 10**9 // rate_hz + phase
        known = [s for r, s in zip(*map(np.ndarray.tolist, arrivals), strict=True) if r <= tick]
        if known and known[-1] not in used:
            used[known[-1]] = tick - known[-1]
        if len(known) == len(arrivals.recv_ns):
            break
    assert sorted(ages_when_used_ns(arrivals, rate_hz, phase).tolist()) == sorted(used.values())
    ages = ages_at_ticks_ns(arrivals, rate_hz, ns(phase))[0]
    first, last = int(arrivals.recv_ns[0]), int(arrivals.recv_ns[-1])
    expected = []
    for k in range(first * rate_hz // 10**9, last * rate_hz // 10**9 + 2):
        if first < k * 10**9 // rate_hz and (k + 1) * 10**9 // rate_hz <= last:
            tick = k * 10**9 // rate_hz + phase
            expected.append(
                tick - max(s for r, s in zip(*map(np.ndarray.tolist, arrivals), strict=True) if r <= tick)
            )
    assert ages.tolist() == expected


@pytest.mark.parametrize(("delay_ms", "usual_ms"), [(3.0, 3.0), (40.0, 40 - PERIOD / MS), (33.3, 33.3)])
def test_a_constant_delay_gets_a_phase_one_hundredth_of_a_period_behind_it(delay_ms: float, usual_ms: float) -> None:
    phase, age, before, error = best_phase([constant(delay_ms)], 30, 2 * MS)
    behind_ms = usual_ms + PERIOD / 100 / MS
    assert phase == pytest.approx((behind_ms * MS) % PERIOD, abs=2)
    assert age == pytest.approx((delay_ms + PERIOD / 100 / MS) * MS, abs=2)
    assert before >= age - 2
    assert error < 2  # instants are rounded to ns


def test_the_best_phase_is_that_of_a_search_of_all_of_them() -> None:
    generator = np.random.default_rng(3)
    sample = instant_ns(np.arange(120), 30)
    arrivals = Arrivals.of(sample + generator.integers(20 * MS, 45 * MS, 120), sample)
    found = best_phase([arrivals], 30, 2 * MS, most_candidates=200)
    phases = np.arange(0, PERIOD, 50_000)
    searched = ages_at_ticks_ns(arrivals, 30, phases).mean(axis=1).min()
    assert found.age_ns <= searched + PERIOD / 100
    now, best = ages_at_ticks_ns(arrivals, 30, ns(2 * MS, found.phase_ns))
    assert found.now_age_ns == now.mean()
    assert found.error_ns == pytest.approx(float(np.std(now - best) / len(now) ** 0.5))


def test_nothing_seen_leaves_the_phase() -> None:
    assert best_phase([constant(5.0, n=1)], 30, 7) == (7, 0.0, 0.0, 0.0)
    assert ages_at_ticks_ns(Arrivals(ns(), ns()), 30, ns(0)).shape == (1, 0)
    assert ages_when_used_ns(Arrivals(ns(), ns()), 30, 0).tolist() == []


def test_a_saw_tooth_worked_by_hand() -> None:
    # sampled at 0, 10, 20; arrived at 4, 16, 22; until 30: ages 4..16, 6..12, 2..10, areas 12*10, 6*9, 8*6
    arrivals = Arrivals(np.array([4, 16, 22]), np.array([0, 10, 20]))
    found = age_of_information(arrivals, 30)
    assert found.mean_ns == pytest.approx((120 + 54 + 48) / 26)
    assert found.peaks_ns.tolist() == [16, 12]


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 60), st.integers(0, 60)), max_size=12), st.integers(0, 90))
def test_the_mean_is_that_of_the_age_at_every_half_ns(pairs: list[tuple[int, int]], until: int) -> None:
    arrivals = Arrivals.of(*np.array([(s + d, s) for s, d in pairs], dtype=np.int64).reshape(-1, 2).T)
    found = age_of_information(arrivals, until)
    first = int(arrivals.recv_ns[0]) if len(pairs) else until
    ages = [
        t + 0.5 - max(s for r, s in zip(*map(np.ndarray.tolist, arrivals), strict=True) if r <= t)
        for t in range(first, until)
    ]
    assert found.mean_ns == (pytest.approx(np.mean(ages)) if ages else None)
