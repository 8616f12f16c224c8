from dataclasses import FrozenInstanceError, replace

import numpy as np
import pytest
from scipy.linalg import block_diag

from tests.patient_side.arm_models import (
    LOST,
    RATE_HZ,
    Streams,
    arm_model,
    at_operating_point,
    delayed,
    play,
    positions,
    random_command,
    random_noise,
    random_space,
    ratio_to_hold,
    simulate,
    static_model,
    tick_ns,
    truth_at_ticks,
)
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.moesp_kf import FilterState, MoespKf
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.filters.kalman import BIAS_STEP, augment
from tis.patient_side.horizon import PATIENCE_SAMPLES, horizon_samples
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

DAMPING, SPEED_NOISE_M = 0.9, 1e-4


def dynamic_model(seed: int = 1, n: int = 3) -> ArmModel:
    rng = np.random.default_rng(seed)
    return arm_model(random_space(rng, n), random_noise(rng, n, 2e-4, 1e-4), DAMPING, SPEED_NOISE_M)


def simulated(model: ArmModel, n: int, seed: int, u_delay_ns: int, y_delay_ns: int) -> Streams:
    rng = np.random.default_rng(seed)
    u = random_command(rng, n, DAMPING, SPEED_NOISE_M)
    return Streams(u, simulate(model, u, rng), delayed(n, u_delay_ns), delayed(n, y_delay_ns))


def textbook(model: ArmModel, u: Array, y: Array, u_lag: int, y_lag: int) -> Array:
    """The Kalman filter in predictor form, known inputs, then the plain model with forecast inputs to each tick.

    Lags are those of the newest samples at a tick, in samples. Returns (N, 3), nan before the first pair.
    """
    space, noise, n = model.space, model.noise, model.space.order
    u, y = u - model.input_offset_m, y - model.output_offset_m
    F = np.block([[space.A, np.zeros((n, 3))], [np.zeros((3, n)), np.eye(3)]])
    G, H = np.vstack([space.B, np.zeros((3, 3))]), np.hstack([space.C, np.eye(3)])
    Q = np.block([[noise.Q, np.zeros((n, 3))], [np.zeros((3, n)), BIAS_STEP**2 * noise.R]])
    S = np.vstack([noise.S, np.zeros((3, 3))])
    prior = augment(model, horizon_samples(RATE_HZ)).P0[: n + 3, : n + 3]
    P = F @ prior @ F.T + Q
    z = np.concatenate([np.linalg.solve(np.eye(n) - space.A, space.B @ u[0]), np.zeros(3)])
    estimates = np.full((len(u), 3), np.nan)
    for k in range(y_lag, len(u)):
        i, newest_u = k - y_lag, k - u_lag
        innovation = H @ P @ H.T + noise.R
        K = np.linalg.solve(innovation, (F @ P @ H.T + S).T).T
        z = F @ z + G @ u[i] + K @ (y[i] - H @ z - space.D @ u[i])
        P = F @ P @ F.T + Q - K @ innovation @ K.T
        path, v = list(u[: newest_u + 1]), u[newest_u] - u[newest_u - 1] if newest_u else np.zeros(3)
        way, newest = np.zeros(3), path[-1]
        while len(path) < k + 2:
            v = DAMPING * v
            way = model.forecast.persistence * way + v
            path.append(newest + way)
        outputs, ahead = [y[i]], z
        for j in range(i + 1, k + 2):
            outputs.append(H @ ahead + space.D @ path[j])
            ahead = F @ ahead + G @ path[j]
        f = (tick_ns(k) - sample_instant_ns(k, RATE_HZ)) / (
            sample_instant_ns(k + 1, RATE_HZ) - sample_instant_ns(k, RATE_HZ)
        )
        estimates[k] = (1.0 - f) * outputs[-2] + f * outputs[-1] + model.output_offset_m
    return estimates


@pytest.mark.parametrize(("n", "persistence"), [(2, 1.0), (3, 0.97), (4, 1.0)])
@pytest.mark.parametrize(("u_lag", "y_lag"), [(5, 5), (0, 5), (1, 1), (0, 0)])
def test_equals_the_textbook_filter_and_prediction(n: int, persistence: float, u_lag: int, y_lag: int) -> None:
    model = at_operating_point(dynamic_model(n, n), [0.1, -0.2, 0.3], [0.01, 0.02, -0.03])
    model = replace(model, forecast=replace(model.forecast, persistence=persistence))
    streams = simulated(model, 120, n, u_lag * 33_333_333, y_lag * 33_333_333)
    shifted = Streams(
        streams.u + model.input_offset_m,
        streams.y + model.output_offset_m,
        streams.u_arrival_ns,
        streams.y_arrival_ns,
    )
    expected = textbook(model, shifted.u, shifted.y, u_lag, y_lag)
    estimated = positions(play(MoespKf(model), shifted))
    if u_lag == y_lag:  # with commands alone the estimate begins earlier
        assert np.array_equal(np.isnan(estimated), np.isnan(expected))
    assert np.nanmax(np.abs(estimated[y_lag:] - expected[y_lag:])) < 1e-9


@pytest.mark.parametrize(
    ("n", "u_delay_ns", "y_delay_ns"),
    [
        (2, 200_000_000, 200_000_000),
        (0, 200_000_000, 200_000_000),
        (2, 0, 200_000_000),  # observer
        (2, 400_000_000, 100_000_000),  # the arm is fresher than the command
        (0, 400_000_000, 100_000_000),
        (2, 100_000_000, 400_000_000),
    ],
)
def test_errors_are_as_large_as_the_covariance_says(n: int, u_delay_ns: int, y_delay_ns: int) -> None:
    model = dynamic_model(7, n)
    streams = simulated(model, 1000, 11, u_delay_ns, y_delay_ns)
    estimates = play(MoespKf(model), streams)[60:]
    errors = positions(estimates) - truth_at_ticks(streams.y)[60:]
    P = np.array([e.covariance_m2 for e in estimates])
    nees = np.einsum("ki,kij,kj->k", errors[:-1], np.linalg.inv(P[:-1]), errors[:-1]) / 3
    assert 0.8 < nees.mean() < 1.25
    inside = np.abs(errors[:-1]) < 1.96 * np.sqrt(np.einsum("kii->ki", P[:-1]))
    assert 0.92 < inside.mean() < 0.98


def test_covariance_between_two_samples_is_that_of_their_mean() -> None:
    model, n = dynamic_model(3, 2), 30
    streams = simulated(model, n, 4, 0, 0)
    playout, augmented = Playout(RATE_HZ), augment(model, horizon_samples(RATE_HZ))
    for i in range(21):
        playout.command.add(i, streams.u[i])
        playout.arm.add(i, streams.y[i])
    now_ns = (sample_instant_ns(22, RATE_HZ) + sample_instant_ns(23, RATE_HZ)) // 2
    state, estimate = MoespKf(model).step(None, playout, now_ns)
    assert state is not None
    assert state.index == 20
    # (y[22] + y[23]) / 2 as a linear map of z[20], w[20] given y[20], w[21], w[22], v[22] and v[23]
    F, H, Q, R, S = augmented.F, augmented.H, augmented.Q_ahead, augmented.R, augmented.S
    z22 = np.hstack([F @ augmented.F_measured, F, np.eye(len(F))])
    y22 = np.hstack([H @ z22, np.zeros((3, len(F))), np.eye(3), np.zeros((3, 3))])
    y23 = np.hstack([H @ F @ z22, H, np.zeros((3, 3)), np.eye(3)])
    noises = block_diag(state.covariance, Q - augmented.T @ S.T, Q, np.block([[Q, S], [S.T, R]]), R)
    expected = (y22 + y23) / 2 @ noises @ (y22 + y23).T / 2
    assert estimate.covariance_m2 is not None
    assert np.allclose(estimate.covariance_m2, expected, rtol=1e-6, atol=0)  # instants are whole ns


def test_an_older_command_that_comes_late_mends_the_velocity() -> None:
    model, playout = static_model(gain=0.5, damping=1.0), Playout(RATE_HZ)
    estimator = MoespKf(model)
    for i, x in enumerate([0.0, 0.0, 0.0, 0.001, 0.004]):
        if i != 3:
            playout.command.add(i, np.full(3, x))
        playout.arm.add(i, np.full(3, 0.5 * x))
    now_ns = sample_instant_ns(6, RATE_HZ)
    state, before = estimator.step(estimator.initial(), playout, now_ns)
    playout.command.add(3, np.full(3, 0.001))
    _, after = estimator.step(state, playout, now_ns)
    assert before.position_m == pytest.approx(np.full(3, 0.5 * (0.004 + 2 * 0.002)), abs=1e-5)
    assert after.position_m == pytest.approx(np.full(3, 0.5 * (0.004 + 2 * 0.003)), abs=1e-5)


def test_work_of_a_tick_is_bounded_when_the_arm_falls_silent() -> None:
    estimator, playout = MoespKf(dynamic_model()), Playout(RATE_HZ)
    playout.arm.add(0, np.zeros(3))
    state = estimator.initial()
    for k in range(250):
        playout.command.add(k, np.zeros(3))
        state, _ = estimator.step(state, playout, tick_ns(k))
    assert state is not None
    assert state.index == 249 - horizon_samples(RATE_HZ) == 99


def test_work_of_a_tick_is_bounded_when_commands_fall_silent() -> None:
    estimator, playout = MoespKf(static_model()), Playout(RATE_HZ)
    playout.command.add(0, np.zeros(3))
    state = estimator.initial()
    for k in range(100):
        playout.arm.add(k, np.zeros(3))
        state, _ = estimator.step(state, playout, tick_ns(k))
    assert state is not None
    assert state.index == 99 - PATIENCE_SAMPLES == 39


def test_a_fresher_arm_sample_beats_the_command_s_forecast() -> None:
    model = static_model()
    streams = simulated(model, 400, 3, 400_000_000, 100_000_000)
    truth = truth_at_ticks(streams.y)[60:-1]
    late = play(MoespKf(model), Streams(streams.u, streams.y, delayed(400, 400_000_000), [LOST] * 400))
    both = play(MoespKf(model), streams)
    assert ratio_to_hold(positions(both)[60:-1], positions(late)[60:-1], truth) < 0.4


def test_a_late_command_leaves_the_state_as_if_it_had_come_in_time() -> None:
    model, n = dynamic_model(4), 60
    streams = simulated(model, n, 5, 100_000_000, 100_000_000)
    held_up = [max(t, tick_ns(50)) if i > 30 else t for i, t in enumerate(streams.u_arrival_ns)]
    late = positions(play(MoespKf(model), Streams(streams.u, streams.y, held_up, streams.y_arrival_ns)))
    punctual = positions(play(MoespKf(model), streams))
    assert np.max(np.abs(late[45] - punctual[45])) > 1e-6
    assert late[50:] == pytest.approx(punctual[50:], abs=1e-12)


def test_smooth_path_at_200_ms() -> None:
    n, t = 900, np.arange(900) / RATE_HZ
    u = np.stack([0.05 * np.sin(2 * np.pi * f * t + f) for f in (0.2, 0.3, 0.5)], axis=1)
    streams = Streams(u, 0.5 * u, delayed(n, 200_000_000), delayed(n, 200_000_000))
    truth = truth_at_ticks(streams.y)[60:-1]
    estimated = positions(play(MoespKf(static_model(damping=0.9)), streams))[60:-1]
    assert ratio_to_hold(estimated, positions(play(Hold(), streams))[60:-1], truth) < 0.5


def test_without_the_arm_it_simulates_the_model() -> None:
    rng = np.random.default_rng(2)
    model = arm_model(random_space(rng, 3), random_noise(rng, 3, 1e-4, 1e-5), damping=1.0)
    n = 400
    u = np.outer(np.arange(n), [1e-4, -2e-4, 0.0])  # steady motion: its forecast is right
    y = model.space.simulate(u)
    estimates = play(MoespKf(model), Streams(u, y, delayed(n, 0), [LOST] * n))
    assert positions(estimates)[1:-1] == pytest.approx(truth_at_ticks(y)[1:-1], abs=1e-9)


def test_without_commands_it_infers_them() -> None:
    model, n = static_model(), 400
    streams = simulated(model, n, 6, 0, 100_000_000)
    silent = Streams(streams.u, streams.y, [LOST] * n, streams.y_arrival_ns)
    truth = truth_at_ticks(streams.y)[60:-1]
    hold = positions(play(Hold(), silent))[60:-1]
    assert ratio_to_hold(positions(play(MoespKf(model), silent))[60:-1], hold, truth) < 0.7


def test_wrong_operating_point_is_taken_up_by_the_bias() -> None:
    model = static_model()
    streams = simulated(model, 200, 8, 100_000_000, 100_000_000)
    moved = Streams(streams.u, streams.y + 0.02, streams.u_arrival_ns, streams.y_arrival_ns)
    shift = positions(play(MoespKf(model), moved)) - positions(play(MoespKf(model), streams))
    assert shift[60:] == pytest.approx(np.full((140, 3), 0.02), abs=1e-6)


def test_says_nothing_before_anything_has_arrived() -> None:
    estimator = MoespKf(static_model())
    assert estimator.step(estimator.initial(), Playout(RATE_HZ), 2_000_000) == (None, (None, None))


def test_estimate_stays_where_it_is_beyond_five_seconds() -> None:
    n = 60 + 5 * RATE_HZ + 60
    u = random_command(np.random.default_rng(9), n, DAMPING, SPEED_NOISE_M)
    arrivals = [t if i < 60 else LOST for i, t in enumerate(delayed(n, 0))]
    estimated = positions(play(MoespKf(static_model(damping=1.0)), Streams(u, 0.5 * u, arrivals, arrivals)))
    at_five_s = 59 + 5 * RATE_HZ
    assert np.array_equal(estimated[at_five_s + 1], estimated[-1])
    assert np.all(np.abs(estimated[at_five_s - 1] - estimated[at_five_s - 3]) > 1e-9)


def test_filter_begins_anew_after_a_long_outage() -> None:
    model = dynamic_model(5)
    streams = simulated(model, 400, 10, 0, 0)
    estimator, playout = MoespKf(model), Playout(RATE_HZ)
    for i in range(20):
        playout.command.add(i, streams.u[i])
        playout.arm.add(i, streams.y[i])
    before, _ = estimator.step(estimator.initial(), playout, tick_ns(20))
    assert before is not None
    assert before.index == 19
    for newest, anew in [(318, False), (321, True)]:  # the horizon is 150 samples
        playout.command.add(newest, streams.u[newest])
        playout.arm.add(newest, streams.y[newest])
        _, after = estimator.step(before, playout, tick_ns(newest + 2))
        _, fresh = estimator.step(None, playout, tick_ns(newest + 2))
        assert np.array_equal(np.asarray(after.position_m), np.asarray(fresh.position_m)) == anew


def test_step_depends_on_nothing_but_its_arguments() -> None:
    model, n = dynamic_model(12), 50
    streams = simulated(model, n, 13, 100_000_000, 50_000_000)
    estimator, playout = MoespKf(model), Playout(RATE_HZ)
    for i in range(40):
        playout.command.add(i, streams.u[i])
        playout.arm.add(i, streams.y[i])
    state, first = estimator.step(estimator.initial(), playout, tick_ns(41))
    assert isinstance(state, FilterState)
    kept = state.mean.copy(), state.covariance.copy()
    again_state, again = MoespKf(model).step(None, playout, tick_ns(41))
    assert isinstance(again_state, FilterState)
    playout.arm.add(41, streams.y[41])
    _, one = estimator.step(state, playout, tick_ns(43))
    estimator.step(None, playout, tick_ns(49))
    _, other = estimator.step(again_state, playout, tick_ns(43))
    assert np.array_equal(np.asarray(first.position_m), np.asarray(again.position_m))
    assert np.array_equal(np.asarray(one.position_m), np.asarray(other.position_m))
    assert np.array_equal(np.asarray(one.covariance_m2), np.asarray(other.covariance_m2))
    assert np.array_equal(state.mean, kept[0])
    assert np.array_equal(state.covariance, kept[1])
    with pytest.raises(ValueError, match="read-only"):
        state.mean[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        state.index = 3  # type: ignore[misc]
