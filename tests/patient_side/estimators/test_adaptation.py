"""Scales tracked on forecasts: against weighted least squares, and by the share of errors within the ellipsoids."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.metrics.consistency import CHI2_3_95
from tis.patient_side.estimators.adaptive_kf import Adaptation, Adapter, Forecast, Scales, octave_of
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout

RATE_HZ = 30
ADAPTER = Adapter(RATE_HZ)
CHECKS_HZ = 10
PERIOD_NS = 1_000_000_000 // CHECKS_HZ
UNIT = np.eye(3)


def arrived(y: Array) -> Playout:
    playout = Playout(RATE_HZ)
    for i, position_m in enumerate(y):
        playout.arm.add(i, position_m)
    return playout


def forecast(sample: int, move_m: Array, *, covariance_m2: Array = UNIT, octave: int = 2) -> Forecast:
    """A forecast of the move since the origin, exactly at a sample, where v stays at the origin."""
    return Forecast(sample, 0.0, octave, np.zeros(3), move_m, move_m, covariance_m2, np.zeros(3), move_m)


def adapted(moves: Array, truths: Array) -> Adaptation:
    """The state after all of these forecasts were kept, and their truths arrived."""
    state = Adaptation()
    for sample, move_m in enumerate(moves):
        state = ADAPTER.kept(state, [forecast(sample, move_m)], sample * PERIOD_NS)
        state = ADAPTER.checked(state, arrived(truths[: sample + 2]))
    return state


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 99), share=st.floats(0.7, 1.4))
def test_velocity_is_weighted_least_squares_with_a_prior(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    moves = rng.normal(size=(60, 3))
    truths = share * moves + 0.3 * rng.normal(size=moves.shape)
    state = adapted(moves, np.vstack([truths, np.zeros(3)]))
    # Rows of weights that are forgotten over 60 s, and 300 rows of the mean square that were right.
    weights = (1.0 - 1.0 / (60 * CHECKS_HZ)) ** np.arange(len(moves))[::-1]
    prior = np.sqrt(300 * np.average(np.sum(moves**2, axis=1), weights=weights))
    rows = np.append((np.sqrt(weights)[:, None] * moves).ravel(), prior)
    values = np.append((np.sqrt(weights)[:, None] * truths).ravel(), prior)
    (expected,) = np.linalg.lstsq(rows[:, None], values, rcond=None)[0]
    assert state.scales_of(2).velocity == pytest.approx(expected, rel=1e-9)
    assert state.scales_of(1) == Scales()


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 99), share=st.floats(-0.5, 1.5))
def test_trust_is_weighted_least_squares_with_a_prior(seed: int, share: float) -> None:
    rng = np.random.default_rng(seed)
    apart = rng.normal(size=(60, 3))
    truths = share * apart + 0.3 * rng.normal(size=apart.shape)
    state = adapted(apart, np.vstack([truths, np.zeros(3)]))
    # What has been learned since, of 1000 in all, is what a row has lost; 10 are the prior's, that v is wrong.
    learned = np.sum(apart**2, axis=1) / 3
    rows_left = np.append(np.cumprod((1 - learned / 1000)[:0:-1])[::-1], 1.0)
    scale = np.sqrt(rows_left / 3)[:, None]
    rows = np.append((scale * apart).ravel(), np.sqrt(10))
    values = np.append((scale * truths).ravel(), np.sqrt(10))
    (w,) = np.linalg.lstsq(rows[:, None], values, rcond=None)[0]
    assert state.scales_of(2).trust == pytest.approx(min(1.0, (2 * max(w, 0.0)) ** 4), rel=1e-6)


def test_one_wild_forecast_changes_little_and_many_leave_no_trust() -> None:
    apart = np.ones((40, 3))
    wild = np.concatenate([apart, 1e6 * np.ones((1, 3))])
    assert adapted(wild, np.ones((42, 3))).scales_of(2).trust == 1.0
    assert adapted(np.concatenate([apart, 1e6 * np.ones((20, 3))]), np.ones((61, 3))).scales_of(2).trust < 0.1
    # lags that were never checked are trusted as the longest that was
    known = Adaptation((), (Scales.of(agreed=1.0, apart=99.0),))
    assert known.scales_of(4).trust == known.scales_of(0).trust < 0.1


def test_longer_lags_than_all_that_were_checked_have_half_of_the_longests_widening() -> None:
    known = Adaptation((), (Scales(), Scales.of(product=1.0, square=2.0, weight=9.0, log_noise=0.6)))
    assert known.scales_of(1).log_noise == 0.6
    assert known.scales_of(5) == Scales.of(log_noise=0.3)
    assert Adaptation().scales_of(5) == Scales()
    # A first check of theirs goes on from there.
    waiting = (forecast(0, UNIT[0], octave=5),)
    scales = ADAPTER.checked(Adaptation(waiting, known.scales), arrived(np.zeros((2, 3)))).scales
    assert [each.log_noise for each in scales[:2]] == [0.0, 0.6]
    assert scales[5].log_noise == pytest.approx(0.3 - (1.0 + 6.0) * 0.06 * 0.05)


@pytest.mark.parametrize("flat", [(), (0,), (2,), (0, 1, 2)])
def test_a_covariance_without_extent_is_no_fault(flat: tuple[int, ...]) -> None:
    covariance = np.diag([0.0 if axis in flat else 1.0 for axis in range(3)])
    for size, outside in ((1.0, 3), (10.0, 4)):
        waiting = (forecast(0, size * np.ones(3), covariance_m2=covariance, octave=0),)
        (scales,) = ADAPTER.checked(Adaptation(waiting), arrived(np.zeros((2, 3)))).scales
        assert (scales.log_noise > 0) == (bool(flat) or outside == 4)


@pytest.mark.parametrize("size", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("heavy", [False, True])
def test_95_per_cent_come_to_lie_within_whatever_the_errors(size: float, heavy: bool) -> None:
    rng = np.random.default_rng(3)
    n = 12_000
    errors = size * (rng.standard_t(3, size=(n, 3)) if heavy else rng.normal(size=(n, 3)))
    playout, scales, within = arrived(np.zeros((2, 3))), Scales(), []
    for error in errors:
        waiting = (forecast(0, error, covariance_m2=scales.noise * UNIT, octave=0),)
        within.append(float(error @ error) <= CHI2_3_95 * scales.noise)
        (scales,) = ADAPTER.checked(Adaptation(waiting, (scales,)), playout).scales
    assert np.mean(within[n // 2 :]) == pytest.approx(0.95, abs=0.006)


def test_a_forecast_awaits_both_samples_around_its_instant() -> None:
    waiting = (Forecast(4, 0.25, 1, np.zeros(3), UNIT[0], UNIT[0], UNIT, np.zeros(3), UNIT[0]),)
    y = np.arange(18.0).reshape(6, 3)
    state = Adaptation(waiting)
    assert ADAPTER.checked(state, arrived(y[:5])) is state
    (_, scales) = ADAPTER.checked(state, arrived(y)).scales
    assert scales.product == pytest.approx(0.75 * y[4, 0] + 0.25 * y[5, 0])


def test_a_forecast_waits_for_late_samples_and_is_dropped_after_five_seconds() -> None:
    playout = Playout(RATE_HZ)
    for sample in (0, 2, 3):
        playout.arm.add(sample, np.ones(3))
    waiting = tuple(forecast(sample, UNIT[0]) for sample in (0, 1, 2, 3))
    state = ADAPTER.checked(Adaptation(waiting), playout)
    assert state.waiting == (waiting[0], waiting[1], waiting[3])
    assert state.scales_of(2).weight == 1.0  # the third one alone has both of its samples
    playout.arm.add(1, np.ones(3))
    late = ADAPTER.checked(state, playout)
    assert late.waiting == (waiting[3],)
    assert late.scales_of(2).weight == pytest.approx(3.0, rel=0.01)
    playout.arm.add(3 + 5 * RATE_HZ, np.ones(3))
    assert ADAPTER.checked(late, playout).waiting == (waiting[3],)
    playout.arm.add(4 + 5 * RATE_HZ, np.ones(3))
    assert ADAPTER.checked(late, playout).waiting == ()


def test_memory_is_bounded_while_nothing_arrives_and_at_any_rate() -> None:
    state = Adaptation()
    for tick in range(20_000):
        state = ADAPTER.kept(state, [forecast(tick, UNIT[0])], tick * 1_000_000)
    assert len(state.waiting) == 110
    kept = [each.sample for each in state.waiting]
    assert np.all(np.diff(kept) >= 90)


def test_nothing_known_changes_nothing_and_scales_are_bounded() -> None:
    assert (Scales().velocity, Scales().noise) == (1.0, 1.0)
    assert Scales.of(product=1e9, square=1.0, weight=1e9).velocity == 1.5
    assert Scales.of(product=-1e9, square=1.0, weight=1e9).velocity == pytest.approx(1 / 1.5)


@pytest.mark.parametrize(("lag", "octave"), [(-0.1, 0), (0.9, 0), (1.0, 1), (2.5, 2), (4.0, 3), (149.0, 8)])
def test_octaves(lag: float, octave: int) -> None:
    assert octave_of(round(lag * 1e9 / RATE_HZ) + 1, RATE_HZ) == octave
