"""The estimator on movements drawn from its own model: what it says of its errors has to be true."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from tests.patient_side.arm_models import (
    LOST,
    RATE_HZ,
    Streams,
    delayed,
    play,
    positions,
    slow_movement,
    static_model,
    tick_ns,
    truth_at_ticks,
)
from tests.patient_side.movements import drawn, joint_covariance, movement_model, moving_arm
from tis.common.errors import DataError
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.protocol import Estimate
from tis.patient_side.filters.innovations_filter import build_innovations_filter
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel
from tis.patient_side.playout import Playout

STRUCTURES = pytest.mark.parametrize("integrated", [False, True])
NS = 1_000_000


def goes_on(integrated: bool) -> InnovationsModel:
    """A velocity that persists: late samples tell something, so the window is not empty."""
    eye, none = np.eye(3), np.zeros((3, 3))
    model = movement_model(3, integrated=integrated)
    if integrated:
        return replace(model, A=0.95 * eye, C=eye, K=0.9 * eye)
    A = np.block([[1.93 * eye, -0.935 * eye], [eye, none]])
    return replace(model, A=A, C=np.hstack([eye, none]), K=np.vstack([1.85 * eye, 0.95 * eye]))


def only_arm(y: Array, arrivals_ns: Sequence[int]) -> Streams:
    return Streams(np.zeros_like(y), y, [LOST] * len(y), arrivals_ns)


def squares(estimates: Sequence[Estimate], truth: Array, first: int) -> Array:
    """Normalised estimation errors squared of the ticks from ``first`` on."""
    values = []
    for estimate, where in list(zip(estimates, truth, strict=True))[first:]:
        assert estimate.position_m is not None
        assert estimate.covariance_m2 is not None
        error = estimate.position_m - where
        values.append(float(error @ np.linalg.solve(estimate.covariance_m2, error)))
    return np.array(values)


@STRUCTURES
@pytest.mark.parametrize("delay_ms", [33, 200])
def test_errors_are_as_large_as_it_says(integrated: bool, delay_ms: int) -> None:
    """NEES of ticks that share no innovation, within its 95 % bounds, loss and jitter included."""
    model, rng = movement_model(4, integrated=integrated), np.random.default_rng(delay_ms)
    y = drawn(model, 3000, rng)
    lost, late = rng.random(len(y)) < 0.1, rng.integers(0, 60 * NS, len(y))
    arrivals = [
        LOST if lost[i] else sample_instant_ns(i, RATE_HZ) + delay_ms * NS + int(late[i]) for i in range(len(y))
    ]
    estimates = play(InnovationsKf(moving_arm(model)), only_arm(y, arrivals))
    apart = 12  # samples of the longest forecast here, and more
    nees = squares(estimates, truth_at_ticks(y), 100)[:-2:apart]
    low, high = np.asarray(chi2.ppf([0.025, 0.975], 3 * len(nees))) / len(nees)
    # the activity is learnt, to about 5 %
    assert 0.93 * low < nees.mean() < 1.07 * high
    assert np.mean(nees < chi2.ppf(0.95, 3)) == pytest.approx(0.95, abs=0.04)


@STRUCTURES
@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_the_order_of_arrival_leaves_no_trace(integrated: bool, seed: int) -> None:
    """Samples as late as the window are replayed: the answer is that of the same samples in order."""
    rng = np.random.default_rng(seed)
    model = moving_arm(goes_on(integrated))
    estimator = InnovationsKf(model, window=6)
    y = drawn(goes_on(integrated), 60, rng)
    lost = rng.random(60) < 0.2
    playout, shuffled = Playout(RATE_HZ), Playout(RATE_HZ)
    state, other = estimator.initial(), estimator.initial()
    for block in range(0, 60, 6):
        indices = [i for i in range(block, block + 6) if not lost[i]]
        for i in indices:
            playout.arm.add(i, y[i])
            state, _ = estimator.step(state, playout, sample_instant_ns(i, RATE_HZ))
        for i in rng.permutation(indices):
            shuffled.arm.add(int(i), y[i])
            other, _ = estimator.step(other, shuffled, sample_instant_ns(block + 5, RATE_HZ))
    now_ns = sample_instant_ns(63, RATE_HZ) + 5 * NS
    (_, first), (_, second) = estimator.step(state, playout, now_ns), estimator.step(other, shuffled, now_ns)
    assert first.position_m is not None
    assert second.position_m is not None
    assert np.max(np.abs(first.position_m - second.position_m)) <= 1e-12
    assert np.allclose(np.asarray(first.covariance_m2), np.asarray(second.covariance_m2), rtol=1e-9)


@given(seed=st.integers(0, 10_000))
@settings(max_examples=15, deadline=None)
def test_of_two_streams_the_order_of_arrival_leaves_no_trace_either(seed: int) -> None:
    """Late pairs of arm and command that come at once, too: neither has stood in for the other before."""
    rng = np.random.default_rng(seed)
    model = goes_on(integrated=True)
    y = drawn(model, 60, rng)
    u = 2 * (y - 0.04)
    estimator = InnovationsKf(moving_arm(model), window=6)
    assert estimator._negligible_error
    lost_arm, lost_command = rng.random((2, 60)) < 0.3
    lost_arm[:6] = lost_command[:6] = False
    playout, shuffled = Playout(RATE_HZ), Playout(RATE_HZ)
    state, other = estimator.initial(), estimator.initial()
    for block in range(0, 60, 6):
        for i in range(block, block + 6):
            if not lost_arm[i] or not lost_command[i]:
                playout.arm.add(i, y[i])
                state, _ = estimator.step(state, playout, sample_instant_ns(i, RATE_HZ))
        for i in rng.permutation(np.arange(block, block + 6)):
            if not lost_arm[i]:
                shuffled.arm.add(int(i), y[i])
            if not lost_command[i]:
                shuffled.command.add(int(i), u[i])
            if rng.random() < 0.6:
                other, _ = estimator.step(other, shuffled, sample_instant_ns(block + 5, RATE_HZ))
    now_ns = sample_instant_ns(63, RATE_HZ) + 5 * NS
    (_, first), (_, second) = estimator.step(state, playout, now_ns), estimator.step(other, shuffled, now_ns)
    # as certain but for the relation's own error, where the newest is a command
    assert np.max(np.abs(positions([first]) - positions([second]))) <= 1e-12
    assert np.allclose(np.asarray(first.covariance_m2), np.asarray(second.covariance_m2), rtol=1e-6, atol=1e-11)


def test_samples_older_than_the_window_are_left_out() -> None:
    y = drawn(goes_on(integrated=True), 40, np.random.default_rng(0))
    estimator = InnovationsKf(moving_arm(goes_on(integrated=True)), window=3)
    playout, state = Playout(RATE_HZ), estimator.initial()
    for i in range(40):
        if i not in (20, 37):
            playout.arm.add(i, y[i])
    now_ns = tick_ns(41)
    state, before = estimator.step(state, playout, now_ns)
    playout.arm.add(20, y[20] + 1.0)
    state, after = estimator.step(state, playout, now_ns)
    assert np.array_equal(positions([before]), positions([after]))
    playout.arm.add(37, y[37])
    state, replayed = estimator.step(state, playout, now_ns)
    assert not np.array_equal(positions([after]), positions([replayed]))


def test_by_default_the_model_says_how_far_to_replay() -> None:
    assert InnovationsKf(moving_arm(goes_on(integrated=True))).window > 0
    still = replace(movement_model(3, integrated=True), K=np.zeros((3, 3)))
    assert InnovationsKf(moving_arm(still)).window == 0


@STRUCTURES
def test_an_unbroken_row_is_the_plain_filter(integrated: bool) -> None:
    """What is worked out beforehand against step by step, between and beyond samples."""
    model = movement_model(4, integrated=integrated)
    y = drawn(model, 48, np.random.default_rng(2))
    estimates = play(InnovationsKf(moving_arm(model)), only_arm(y, delayed(48, 100 * NS)))
    filter_ = build_innovations_filter(model, 20)
    mean, covariance = filter_.start(y[0])
    for k in range(1, 45):
        mean, covariance, _ = filter_.update(mean, covariance, 1, y[k])
        tick = k + 3  # 100 ms are 3 samples, and the tick is 2 ms after
        weights = filter_.weights(3, (tick_ns(tick) - sample_instant_ns(tick, RATE_HZ)) * RATE_HZ / 1e9)
        assert np.max(np.abs(positions([estimates[tick]])[0] - (weights @ mean).ravel())) < 1e-9 * 0.03


@STRUCTURES
def test_a_fraction_of_a_sample_is_the_forecast_between(integrated: bool) -> None:
    y = drawn(goes_on(integrated), 50, np.random.default_rng(1))
    estimator = InnovationsKf(moving_arm(goes_on(integrated)))
    playout, state = Playout(RATE_HZ), estimator.initial()
    for i in (*range(44), 47, 49):
        playout.arm.add(i, y[i])
    at = [sample_instant_ns(49 + h, RATE_HZ) for h in (2, 3)]
    times = np.linspace(at[0], at[1], 12).astype(int)
    dense = []
    for now_ns in times:
        state, estimate = estimator.step(state, playout, int(now_ns))
        dense.append(positions([estimate])[0])
    shares = ((times - at[0]) / (at[1] - at[0]))[:, None]
    straight = (1 - shares) * dense[0] + shares * dense[-1]
    assert np.max(np.abs(np.array(dense) - straight)) < 1e-9  # lags are told apart to 64 ns


def test_in_an_outage_it_comes_to_rest() -> None:
    model = goes_on(integrated=True)
    y = drawn(model, 200, np.random.default_rng(1))
    estimator = InnovationsKf(moving_arm(model))
    playout, state = Playout(RATE_HZ), estimator.initial()
    for i in range(200):
        playout.arm.add(i, y[i])
    where, spread = [], []
    for seconds in (0, 2, 4, 5, 6, 60):
        state, estimate = estimator.step(state, playout, sample_instant_ns(199 + 30 * seconds, RATE_HZ))
        where.append(positions([estimate])[0])
        spread.append(float(np.trace(np.asarray(estimate.covariance_m2))))
    assert np.array_equal(where[0], y[199])
    reach = np.max(np.abs(y[199] - y[198])) * 0.95 / 0.05  # what the last velocity adds up to
    assert np.max(np.abs(where[-1] - y[199])) < 2 * reach
    assert np.array_equal(where[3], where[4])
    assert np.array_equal(where[3], where[5])
    assert spread == sorted(spread)


@STRUCTURES
def test_the_command_stands_in_for_samples_that_have_not_arrived(integrated: bool) -> None:
    """With the command undelayed the error is that of the relation, which is also what it says."""
    model, rng = movement_model(4, integrated=integrated), np.random.default_rng(4)
    y = drawn(model, 400, rng)
    for relation_m in (1e-6, 5e-5):  # as good as a sample of the arm, and not
        u = 2 * (y + relation_m * rng.normal(size=y.shape) - 0.04)
        streams = Streams(u, y, delayed(400, 0), delayed(400, 200 * NS))
        estimates = play(InnovationsKf(moving_arm(model, relation_m)), streams)
        alone = play(InnovationsKf(moving_arm(model, relation_m)), only_arm(y, streams.y_arrival_ns))
        error, truth = positions(estimates) - truth_at_ticks(y), truth_at_ticks(y)
        assert (
            np.sqrt(np.mean(error[50:-1] ** 2))
            < 0.1 * np.sqrt(np.mean((positions(alone) - truth)[50:-1] ** 2)) + 1.5 * relation_m
        )
        assert squares(estimates, truth, 50)[:-1].mean() == pytest.approx(3.0, abs=1.2)


def test_two_streams_of_which_each_loses_half_are_as_good_as_one() -> None:
    model, rng = goes_on(integrated=True), np.random.default_rng(4)
    y = drawn(model, 600, rng)
    u = 2 * (y - 0.04)
    arrivals = delayed(600, 100 * NS)
    even = [t if i % 2 or i < 20 else LOST for i, t in enumerate(arrivals)]
    odd = [LOST if i % 2 and i >= 20 else t for i, t in enumerate(arrivals)]
    estimator = InnovationsKf(moving_arm(model))
    both, whole = play(estimator, Streams(u, y, odd, even)), play(estimator, only_arm(y, arrivals))
    assert np.max(np.abs(positions(both)[30:] - positions(whole)[30:])) < 1e-9


def test_without_the_arm_the_command_alone_tells_what_the_model_knows_of_the_offset() -> None:
    model = moving_arm(movement_model(4, integrated=True))
    y = drawn(movement_model(4, integrated=True), 60, np.random.default_rng(0), level_m=0.0)
    streams = Streams(2 * y, y, delayed(60, 0), [LOST] * 60)
    own, others = play(InnovationsKf(model), streams), play(InnovationsKf(replace(model, train="others")), streams)
    assert np.max(np.abs(positions(own)[5:-1] - truth_at_ticks(y)[5:-1])) < 1e-4
    assert np.array_equal(positions(own), positions(others))
    # an offset of another set-up may be as wrong as the arm moves: 10 cm here
    assert np.sqrt(np.trace(np.asarray(others[-1].covariance_m2)) / 3) == pytest.approx(0.1, rel=0.01)


def test_an_offset_that_no_arm_sample_has_confirmed_is_dropped_for_the_true_one() -> None:
    model = moving_arm(movement_model(4, integrated=True))
    y = drawn(movement_model(4, integrated=True), 60, np.random.default_rng(0))
    u = 2 * (y - 0.05)
    estimates = positions(play(InnovationsKf(model), Streams(u, y, delayed(60, 0), delayed(60, 500 * NS))))
    error = np.max(np.abs(estimates - truth_at_ticks(y)), axis=1)
    assert error[10] > 0.04
    assert np.all(error[17:-1] < 1e-3)


def test_the_first_sample_of_the_arm_ends_a_guess_also_where_it_is_the_next_in_order() -> None:
    estimator, playout = InnovationsKf(static_model(noise_m=1e-7)), Playout(RATE_HZ)
    state = estimator.initial()
    for k in range(12):
        if k < 10:
            playout.command.add(k, np.array([0.02, 0.0, 0.0]))
        else:
            playout.arm.add(k, np.array([0.012, 0.0, 0.0]))  # 2 mm beside what the commands let expect
        state, estimate = estimator.step(state, playout, sample_instant_ns(k, RATE_HZ) + 300 * NS)
        if k >= 10:
            assert estimate.position_m is not None
            assert abs(estimate.position_m[0] - 0.012) < 1e-6


def test_a_relation_with_states_is_no_gain() -> None:
    """Commands of an arm that is no gain of them tell nothing: the same with and without."""
    arm = replace(moving_arm(movement_model(4)), static=False)
    y = drawn(movement_model(4), 80, np.random.default_rng(0))
    arrivals = delayed(80, 100 * NS)
    with_commands = play(InnovationsKf(arm), Streams(2 * y, y, delayed(80, 0), arrivals))
    assert np.array_equal(
        positions(with_commands), positions(play(InnovationsKf(arm), only_arm(y, arrivals))), equal_nan=True
    )


def test_a_gap_of_more_than_five_seconds_starts_it_anew() -> None:
    y = drawn(movement_model(4), 30, np.random.default_rng(0))
    estimator = InnovationsKf(moving_arm(movement_model(4)))
    playout, state = Playout(RATE_HZ), estimator.initial()
    for i in range(30):
        playout.arm.add(i, y[i])
    state, _ = estimator.step(state, playout, tick_ns(30))
    fresh, new = Playout(RATE_HZ), estimator.initial()
    for buffers in (playout, fresh):
        buffers.arm.add(500, y[3])
    state, late = estimator.step(state, playout, tick_ns(501))
    _, alone = estimator.step(new, fresh, tick_ns(501))
    assert np.array_equal(positions([late]), positions([alone]))


def test_a_step_can_be_taken_again_from_the_same_state() -> None:
    model = moving_arm(goes_on(integrated=True))
    y = drawn(goes_on(integrated=True), 30, np.random.default_rng(0))
    estimator, playout = InnovationsKf(model), Playout(RATE_HZ)
    state = estimator.initial()
    for i in range(20):
        playout.arm.add(i, y[i])
    state, _ = estimator.step(state, playout, tick_ns(20))
    playout.arm.add(25, y[25])
    playout.arm.add(22, y[22])
    first = estimator.step(state, playout, tick_ns(26))
    estimator.step(first[0], playout, tick_ns(27))
    again = estimator.step(state, playout, tick_ns(26))
    assert np.array_equal(positions([first[1]]), positions([again[1]]))


def test_covariances_have_the_scale_of_the_model_and_follow_the_activity() -> None:
    model = movement_model(4, integrated=True)
    wide = replace(model, scale_horizons=np.array([1.0, 5.0]), covariance_scale=np.array([2.0, 4.0]))
    y = drawn(model, 900, np.random.default_rng(5))
    streams = only_arm(y, delayed(900, 98 * NS))
    plain, scaled = play(InnovationsKf(moving_arm(model)), streams), play(InnovationsKf(moving_arm(wide)), streams)
    # 98 ms and the tick's 2 ms are 3 samples: halfway from 2 at 1 to 4 at 5
    assert np.allclose(np.asarray(scaled[60].covariance_m2), 3.0 * np.asarray(plain[60].covariance_m2))
    lively = play(InnovationsKf(moving_arm(model)), only_arm(3.0 * y, delayed(900, 98 * NS)))
    ratio = np.trace(np.asarray(lively[-1].covariance_m2)) / np.trace(np.asarray(plain[-1].covariance_m2))
    assert ratio == pytest.approx((60 + 840 * 9) / (60 + 840), rel=0.1)  # as far as learnt from 1
    assert np.allclose(positions(lively)[10:], 3.0 * positions(plain)[10:], rtol=0, atol=1e-9)


def test_without_an_innovations_form_it_says_what_is_missing() -> None:
    with pytest.raises(DataError, match="innovations"):
        InnovationsKf(replace(static_model(), innovations=None))


def test_nothing_is_said_before_anything_has_arrived() -> None:
    estimator = InnovationsKf(moving_arm(movement_model(4)))
    _, estimate = estimator.step(estimator.initial(), Playout(RATE_HZ), tick_ns(5))
    assert estimate.position_m is None


def test_it_is_one_shot_conditioning_of_what_has_arrived() -> None:
    """The whole of it: gaps, late samples and an age between samples, against the joint Gaussian."""
    model = goes_on(integrated=True)
    y = drawn(model, 30, np.random.default_rng(8))
    arrived = [0, 1, 2, 5, 9, 10, 14, 13, 17]
    estimator = InnovationsKf(moving_arm(model), window=4)
    playout, state = Playout(RATE_HZ), estimator.initial()
    for i in arrived:
        playout.arm.add(i, y[i])
        state, estimate = estimator.step(state, playout, sample_instant_ns(20, RATE_HZ) + 11 * NS)
    known = sorted(arrived)
    joint = joint_covariance(model, 30)
    rows = np.concatenate([np.arange(3 * i, 3 * i + 3) for i in known])
    share = 11 * NS * RATE_HZ / 1e9
    target = (1 - share) * joint[60:63] + share * joint[63:66]
    # relative to the first sample nothing is unknown
    first = np.tile(np.eye(3), (len(known), 1))
    seen = joint[np.ix_(rows, rows)]
    weighted = np.linalg.solve(seen, first)
    constant = np.linalg.solve(first.T @ weighted, weighted.T @ y[known].reshape(-1))
    gain = np.linalg.solve(seen, target[:, rows].T).T
    expected = constant + gain @ (y[known].reshape(-1) - first @ constant)
    assert np.max(np.abs(positions([estimate])[0] - expected)) < 1e-10


@pytest.mark.parametrize("alike", [False, True])
@pytest.mark.parametrize("lost", [(), (60,)])
def test_after_a_jump_the_movement_goes_on_from_the_new_place(alike: bool, lost: tuple[int, ...]) -> None:
    """As if it had been there all the time: the step is no velocity."""
    model = slow_movement() if alike else goes_on(integrated=False)
    y = drawn(model, 100, np.random.default_rng(4))
    jumped = y.copy()
    jumped[61:] += (0.024, -0.01, 0.005)
    arrivals = [LOST if i in lost else t for i, t in enumerate(delayed(100, 100 * NS))]
    still, moved = (
        positions(play(InnovationsKf(moving_arm(model)), only_arm(each, arrivals)))[64:70] for each in (y, jumped)
    )
    assert np.max(np.abs(moved - still - (0.024, -0.01, 0.005))) < 1e-3


def test_a_single_sample_far_away_leaves_the_movement_as_it_was() -> None:
    model = slow_movement()
    y = drawn(model, 100, np.random.default_rng(4))
    far = y.copy()
    far[60] += (0.024, -0.01, 0.005)
    as_it_was, moved = (
        positions(play(InnovationsKf(moving_arm(model)), only_arm(each, delayed(100, 100 * NS))))[65:70]
        for each in (y, far)
    )
    assert np.max(np.abs(moved - as_it_was)) < 1e-3


def test_a_fast_hand_that_stops_at_once_is_not_one_that_jumps_back_for_ever() -> None:
    model = replace(slow_movement(), A=0.95 * np.eye(3), C=np.eye(3), K=0.95 * np.eye(3), integrated=True)
    speeds_m = np.concatenate([np.zeros(40), 0.002 * np.arange(20), np.zeros(40)])
    y = np.cumsum(speeds_m)[:, None] * (1.0, 0.0, 0.0)
    estimates = positions(play(InnovationsKf(moving_arm(model)), only_arm(y, delayed(100, 100 * NS))))
    # two samples tell that it has stopped, and arrive 100 ms later
    assert np.max(np.abs(estimates[66:] - y[-1])) < 1e-3


@pytest.mark.parametrize("lost", [(), (63,)])
def test_a_hand_that_changes_its_speed_at_once_is_followed_again(lost: tuple[int, ...]) -> None:
    """As after a gap that a straight line bridges: an estimate that came to rest at each jump would hold for ever."""
    eye = np.eye(3)
    model = replace(slow_movement(), A=0.999 * eye, C=eye, K=0.9 * eye, Re=1e-9 * eye, integrated=True)
    t_s = np.arange(150) / RATE_HZ
    along_m = 0.05 * np.sin(2.0 * np.pi * 0.2 * t_s) + 0.2 * np.maximum(t_s - 2.0, 0.0)
    y = along_m[:, None] * (1.0, 0.5, 0.0)
    arrivals = [LOST if i in lost else t for i, t in enumerate(delayed(150, 100 * NS))]
    errors = positions(play(InnovationsKf(moving_arm(model)), only_arm(y, arrivals))) - truth_at_ticks(y)
    assert np.max(np.abs(errors[68:-1])) < 1e-3
