"""The adaptive filter: by what it makes of hands that move like the model, and of those that do not."""

from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.arm_models import (
    LOST,
    RATE_HZ,
    Streams,
    delayed,
    play,
    positions,
    slow_movement,
    truth_at_ticks,
)
from tests.patient_side.movements import drawn, moving_arm
from tis.common.metrics.consistency import CHI2_3_95
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.adaptive_kf import AdaptiveKf
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.simple import DampedVelocity
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import InnovationsModel
from tis.patient_side.playout import Playout

N = 4000


def arm_only(y: Array, delay_ms: int = 200) -> Streams:
    return Streams(np.zeros_like(y), y, [LOST] * len(y), delayed(len(y), delay_ms * 1_000_000))


def errors_and_inside(estimator: InnovationsKf | AdaptiveKf, streams: Streams) -> tuple[Array, float]:
    """Errors over the second half, and the share within the 95 % ellipsoids."""
    estimates, half = play(estimator, streams), len(streams.y) // 2
    errors = (positions(estimates) - truth_at_ticks(streams.y))[half:-1]
    covariances = np.array([each.covariance_m2 for each in estimates[half:-1]])
    squares = np.einsum("ti,tij,tj->t", errors, np.linalg.inv(covariances), errors)
    return errors, float(np.mean(squares <= CHI2_3_95))


def persistent(share: float) -> InnovationsModel:
    """A movement whose increments persist by ``share``, alike in all axes."""
    eye = np.eye(3)
    return replace(slow_movement(), A=share * eye, C=eye, K=share * eye, integrated=True)


def test_a_hand_that_moves_like_the_model_keeps_the_estimate() -> None:
    model = persistent(0.9)
    streams = arm_only(drawn(model, N, np.random.default_rng(1)))
    (plain, _), (adaptive, inside) = (
        errors_and_inside(build(moving_arm(model)), streams) for build in (InnovationsKf, AdaptiveKf)
    )
    assert np.sqrt(np.mean(adaptive**2) / np.mean(plain**2)) < 1.01
    assert 0.93 <= inside <= 0.97


def test_the_velocity_of_a_hand_that_goes_on_for_longer_is_found() -> None:
    streams = arm_only(drawn(persistent(0.95), N, np.random.default_rng(2)))
    arm = moving_arm(persistent(0.8))
    (plain, _), (adaptive, _) = (errors_and_inside(build(arm), streams) for build in (InnovationsKf, AdaptiveKf))
    assert np.sqrt(np.mean(adaptive**2) / np.mean(plain**2)) < 0.95


def test_the_covariance_of_a_wrong_model_comes_to_hold() -> None:
    streams = arm_only(drawn(persistent(0.95), N, np.random.default_rng(3)))
    arm = moving_arm(persistent(0.8))
    (_, plain), (_, adaptive) = (errors_and_inside(build(arm), streams) for build in (InnovationsKf, AdaptiveKf))
    assert plain < 0.9
    assert 0.93 <= adaptive <= 0.97


def test_before_a_forecast_is_checked_it_is_the_filter_itself() -> None:
    model = persistent(0.9)
    streams = arm_only(drawn(model, 20, np.random.default_rng(4)), delay_ms=300)
    plain, adaptive = (play(build(moving_arm(model)), streams) for build in (InnovationsKf, AdaptiveKf))
    first = next(k for k, each in enumerate(plain) if each.position_m is not None)
    for one, other in zip(plain[first : first + 8], adaptive[first : first + 8], strict=True):
        assert np.allclose(np.asarray(one.position_m), np.asarray(other.position_m), rtol=0, atol=1e-15)
        assert np.array_equal(np.asarray(one.covariance_m2), np.asarray(other.covariance_m2))


def test_without_a_lag_there_is_nothing_to_adapt() -> None:
    """The arm's sample of this very instant is certain: its covariance is zero."""
    model = persistent(0.9)
    y = drawn(model, 40, np.random.default_rng(5))
    estimator, playout = AdaptiveKf(moving_arm(model)), Playout(RATE_HZ)
    state = estimator.initial()
    for k, position_m in enumerate(y):
        playout.arm.add(k, position_m)
        state, estimate = estimator.step(state, playout, sample_instant_ns(k, RATE_HZ))
        assert np.asarray(estimate.position_m) == pytest.approx(position_m, abs=1e-12)
    assert state[1].waiting == ()


def test_of_a_device_that_the_model_does_not_fit_the_forecast_comes_down_to_the_damped_velocity() -> None:
    """Noise that training rows did not have, in a model that goes on at the last acceleration."""
    axis = np.array([[1.8, -0.81], [1.0, 0.0]])
    model = replace(
        slow_movement(),
        A=np.kron(axis, np.eye(3)),
        C=np.kron(axis[:1], np.eye(3)),
        K=np.kron(np.array([[1.0], [0.0]]), np.eye(3)),
        integrated=True,
    )
    t_s = np.arange(N)[:, None] / RATE_HZ
    y = 0.03 * np.sin(t_s * (1.0, 1.3, 0.7)) + 0.001 * np.random.default_rng(6).normal(size=(N, 3))
    arm, streams = moving_arm(model), arm_only(y)
    plain, adaptive, velocity = (
        np.sqrt(np.mean((positions(play(build(arm), streams)) - truth_at_ticks(y))[N // 2 : -1] ** 2))
        for build in (InnovationsKf, AdaptiveKf, DampedVelocity)
    )
    assert plain > 2 * velocity
    assert adaptive < 1.02 * velocity


def test_a_wrong_covariance_comes_to_hold_within_seconds() -> None:
    """Over ticks 3 to 11 s after the start, of a model whose own ellipsoids hold less than 90 %."""
    inside = []
    for seed in range(12):
        streams = arm_only(drawn(persistent(0.95), 330, np.random.default_rng(seed)))
        estimates = play(AdaptiveKf(moving_arm(persistent(0.8))), streams)
        errors = (positions(estimates) - truth_at_ticks(streams.y))[90:-1]
        covariances = np.array([each.covariance_m2 for each in estimates[90:-1]])
        squares = np.einsum("ti,tij,tj->t", errors, np.linalg.inv(covariances), errors)
        inside.append(np.mean(squares <= CHI2_3_95))
    assert 0.94 <= np.mean(inside) <= 0.98


def test_an_outage_finds_its_lags_rehearsed() -> None:
    """A hand that moves more than the model says, at 33 ms until nothing arrives for a second."""
    errors, covariances = [], []
    for seed in range(12):
        y = 3.0 * np.cumsum(drawn(persistent(0.9), 1000, np.random.default_rng(seed)), axis=0) * 0.02
        arrivals = [LOST if 950 <= i < 980 else t for i, t in enumerate(delayed(len(y), 33_000_000))]
        estimates = play(
            AdaptiveKf(moving_arm(persistent(0.9))), Streams(np.zeros_like(y), y, [LOST] * len(y), arrivals)
        )
        errors.append((positions(estimates) - truth_at_ticks(y))[965:978])
        covariances.append([each.covariance_m2 for each in estimates[965:978]])
    squares = np.einsum("sti,stij,stj->st", errors, np.linalg.inv(np.array(covariances)), errors)
    assert np.mean(squares <= CHI2_3_95) > 0.85
