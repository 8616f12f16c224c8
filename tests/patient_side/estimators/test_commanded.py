"""`innovations_kf` of an arm that lags: its command tells what need not be foretold."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.arm_models import LOST, RATE_HZ, Streams, play, positions, truth_at_ticks
from tis.common.scenario.identification import Identification
from tis.common.scenario.source import SyntheticSource
from tis.common.sources.sensor_noise import with_noise
from tis.common.sources.synthetic import synthesise
from tis.common.units import sample_instant_ns
from tis.patient_side.estimators.innovations_kf import InnovationsKf
from tis.patient_side.estimators.moesp_kf import MoespKf, arx_kf
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.identification.identify import identify_arm
from tis.patient_side.identification.model_file import dump_models, parse_models
from tis.patient_side.linear_system import Array
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel

N_TRAIN, N = 1800, 300
NS = 1_000_000


@cache
def lagging(bandwidth_hz: float = 4.0) -> tuple[ArmModel, Array, Array]:
    source = SyntheticSource(kind="synthetic", arm_bandwidth_hz=bandwidth_hz, recorder_hz=None)
    whole = synthesise(source, 2, RATE_HZ, N_TRAIN + N, 0)
    model = identify_arm([whole.head(N_TRAIN)], "left", Identification(), "", {"innovations_kf", "arx_kf"})
    hand = whole.hands[0]
    return model, hand.command.position_m[N_TRAIN:], hand.follower.position_m[N_TRAIN:]


def error_m(estimator: Estimator, arm_ns: list[int], command_ns: list[int]) -> float:
    _, u, y = lagging()
    estimates = positions(play(estimator, Streams(u, y, command_ns, arm_ns)))
    wrong = (estimates - truth_at_ticks(y))[60:]
    return float(np.sqrt(np.mean(wrong**2)))


def arrivals(seed: int, delay_ms: float, jitter_ms: float, p_loss: float) -> list[int]:
    rng = np.random.default_rng(seed)
    late = delay_ms + jitter_ms * rng.random(N)
    lost = rng.random(N) < p_loss
    return [LOST if lost[i] else sample_instant_ns(i, RATE_HZ) + int(late[i] * NS) for i in range(N)]


@pytest.mark.parametrize(
    ("delay_ms", "jitter_ms", "p_loss"), [(33.0, 0.0, 0.0), (200.0, 0.0, 0.0), (1000.0, 0.0, 0.0), (50.0, 250.0, 0.1)]
)
def test_of_an_arm_that_lags_no_other_filter_knows_more(delay_ms: float, jitter_ms: float, p_loss: float) -> None:
    model, _, _ = lagging()
    assert model.commanded is not None
    streams = arrivals(1, delay_ms, jitter_ms, p_loss), arrivals(2, delay_ms, jitter_ms, p_loss)
    others = [error_m(estimator, *streams) for estimator in (MoespKf(model), arx_kf(model))]
    assert error_m(InnovationsKf(model), *streams) < 1.02 * min(others)


def test_of_an_arm_whose_sensor_errs_it_knows_more_than_its_samples() -> None:
    """Errors of 0.2 mm: no other filter is nearer to the arm; it is nearer than a sample that was just taken."""
    source = SyntheticSource(kind="synthetic", arm_bandwidth_hz=2.0, recorder_hz=None)
    whole = synthesise(source, 2, RATE_HZ, N_TRAIN + N, 0)
    seen = with_noise(whole, 2e-4, 1)
    model = identify_arm([seen.head(N_TRAIN)], "left", Identification(), "", {"innovations_kf", "arx_kf"})
    assert model.commanded is not None
    assert model.commanded.response is not None
    assert model.commanded.response.error > 0.0
    u, y = (of.position_m[N_TRAIN:] for of in (seen.hands[0].command, seen.hands[0].follower))
    truth = truth_at_ticks(whole.hands[0].follower.position_m[N_TRAIN:])

    def error_mm(estimator: Estimator, delay_ms: float) -> float:
        streams = Streams(u, y, arrivals(1, delay_ms, 0.0, 0.0), arrivals(1, delay_ms, 0.0, 0.0))
        return 1e3 * float(np.sqrt(np.mean((positions(play(estimator, streams)) - truth)[60:] ** 2)))

    assert error_mm(InnovationsKf(model), 1.0) < 0.15
    others = [error_mm(estimator, 100.0) for estimator in (MoespKf(model), arx_kf(model))]
    assert error_mm(InnovationsKf(model), 100.0) < min(others)


def test_commands_at_once_leave_next_to_nothing_to_guess() -> None:
    """The arm goes where its command is: what the increments do not explain does not add up."""
    model, u, y = lagging(1.0)
    at_once, late = arrivals(0, 0.0, 0.0, 0.0), arrivals(0, 1000.0, 0.0, 0.0)
    wrong = [
        positions(play(each, Streams(u, y, at_once, late))) - truth_at_ticks(y)
        for each in (InnovationsKf(model), arx_kf(model))
    ]
    default, arx = (float(np.sqrt(np.mean(each[60:] ** 2))) for each in wrong)
    assert default < 1.02 * arx
    assert default < 0.01 * float(np.sqrt(np.mean((y[90:] - y[60:-30]) ** 2)))


def test_a_command_that_a_clutch_moved_is_followed_from_there() -> None:
    """Training knew one offset between command and arm: two samples that it does not explain show a new one."""
    model, u, y = lagging()
    assert model.commanded is not None
    assert model.commanded.response is not None
    assert model.commanded.response.pull > 0.0
    moved = np.clip(np.arange(N) - 120, 0, 30) / 30 * 0.03
    clutched = u + moved[:, None] * np.array([1.0, 0.5, -0.5])
    arrived = arrivals(0, 200.0, 0.0, 0.0)
    wrong = [
        positions(play(InnovationsKf(model), Streams(each, y, arrived, arrived))) - truth_at_ticks(y)
        for each in (u, clutched)
    ]
    without, after = (float(np.sqrt(np.mean(each[170:] ** 2))) for each in wrong)
    assert after < 1.1 * without


def test_an_arm_that_is_struck_comes_back_and_so_does_its_estimate() -> None:
    """It is 35 mm away for three samples, whose increments alone, run on for half a second, would be 0.7 m."""
    model, u, y = lagging(1.0)
    struck = y.copy()
    struck[150:153] += 0.02
    arrived = arrivals(0, 500.0, 0.0, 0.0)
    found = [positions(play(InnovationsKf(model), Streams(u, each, arrived, arrived)))[60:] for each in (struck, y)]
    moved = np.linalg.norm(found[0] - found[1], axis=1)
    assert np.max(moved) < 4 * 0.035
    assert np.max(moved[112:]) < 1.5e-3


@given(seed=st.integers(0, 10_000))
@settings(max_examples=10, deadline=None)
def test_the_order_in_which_both_arrive_leaves_no_trace(seed: int) -> None:
    model, u, y = lagging()
    rng = np.random.default_rng(seed)
    estimator = InnovationsKf(model, window=8)
    lost = rng.random((2, 60)) < 0.3
    playout, shuffled = Playout(RATE_HZ), Playout(RATE_HZ)
    state, other = estimator.initial(), estimator.initial()
    for block in range(0, 60, 6):
        here = range(block, block + 6)
        for i in here:
            for of, buffer, rows in ((lost[0], playout.command, u), (lost[1], playout.arm, y)):
                if not of[i]:
                    buffer.add(i, rows[i])
            state, _ = estimator.step(state, playout, sample_instant_ns(i, RATE_HZ))
        for stream, i in rng.permutation([(stream, i) for stream in (0, 1) for i in here]).tolist():
            if not lost[stream, i]:
                (shuffled.arm if stream else shuffled.command).add(i, (y if stream else u)[i])
            if rng.random() < 0.5:
                other, _ = estimator.step(other, shuffled, sample_instant_ns(block + 5, RATE_HZ))
    now_ns = sample_instant_ns(63, RATE_HZ)
    (_, first), (_, second) = estimator.step(state, playout, now_ns), estimator.step(other, shuffled, now_ns)
    assert np.max(np.abs(positions([first]) - positions([second]))) <= 1e-9
    assert np.allclose(np.asarray(first.covariance_m2), np.asarray(second.covariance_m2), rtol=1e-5, atol=1e-13)


@pytest.mark.parametrize("alone", ["command", "arm"])
def test_one_of_the_streams_is_enough(alone: str) -> None:
    model, _, y = lagging()
    both = {"command": [LOST] * N, "arm": [LOST] * N} | {alone: arrivals(0, 100.0, 0.0, 0.0)}
    wrong = error_m(InnovationsKf(model), both["arm"], both["command"])
    assert wrong < 0.7 * float(np.sqrt(np.mean((y[63:] - y[60:-3]) ** 2))) + (2e-3 if alone == "command" else 0.0)


def test_a_model_file_keeps_the_response_and_an_older_one_has_none() -> None:
    model, _, _ = lagging()
    (back,) = parse_models(dump_models([model]), "m.json")
    assert back.commanded is not None
    assert model.commanded is not None
    assert back.commanded.response is not None
    assert model.commanded.response is not None
    assert back.commanded.response.own.tolist() == model.commanded.response.own.tolist()
