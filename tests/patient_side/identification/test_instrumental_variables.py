"""The response of an arm whose sensor errs: servos and sensors that are known."""

import numpy as np
import pytest
import scipy

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise
from tis.patient_side.identification.arm_response import fit_response
from tis.patient_side.identification.instrumental_variables import fit_noisy_response
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import ArmResponse

RATE_HZ = 120


def servo(bandwidth_hz: float, n_rows: int, seed: int = 5) -> tuple[Array, Array]:
    source = SyntheticSource(kind="synthetic", arm_bandwidth_hz=bandwidth_hz, recorder_hz=None)
    hand = synthesise(source, seed, RATE_HZ, n_rows, 0).hands[0]
    return hand.command.position_m, hand.follower.position_m


def simulated(response: ArmResponse, u: Array) -> Array:
    """The arm about its mean as the response makes it of the commands."""
    poles = np.concatenate([[1.0], -response.own])
    y = np.cumsum(scipy.signal.lfilter(response.command, poles, np.diff(u @ response.gain.T, axis=0), axis=0), axis=0)
    return np.asarray(y - y.mean(axis=0))


@pytest.mark.parametrize("noise_mm", [0.05, 0.2])
@pytest.mark.parametrize("bandwidth_hz", [2.0, 8.0])
def test_servo_and_sensor_are_found_beneath_its_errors(bandwidth_hz: float, noise_mm: float) -> None:
    u, y = servo(bandwidth_hz, 1240)
    rng = np.random.default_rng(1)
    seen = [each + 1e-3 * noise_mm * rng.normal(size=each.shape) for each in (u, y)]
    response = fit_noisy_response([(seen[0], seen[1])], RATE_HZ)
    assert response is not None
    # The errors of the command enter by the servo, which smooths them.
    assert np.sqrt(response.error) == pytest.approx(1e-3 * noise_mm, rel=0.1)
    truth = y[1:] - y[1:].mean(axis=0)
    left = 1e3 * np.sqrt(np.mean((simulated(response, seen[0]) - truth) ** 2))
    assert left < 0.6 * noise_mm
    exact = fit_response([(seen[0], seen[1])], RATE_HZ)
    assert exact is not None
    assert left < 0.5 * 1e3 * np.sqrt(np.mean((simulated(exact, seen[0]) - truth) ** 2))


def test_a_sensor_without_errors_has_hardly_any() -> None:
    u, y = servo(2.0, 1240)
    response = fit_noisy_response([(u, y)], RATE_HZ)
    assert response is None or np.sqrt(response.error) < 2e-6


def test_directions_and_units_of_the_command_are_the_gains() -> None:
    u, y = servo(2.0, 1240)
    y = y + 5e-5 * np.random.default_rng(2).normal(size=y.shape)
    turn = np.array([[0.0, 2.0, 0.0], [-2.0, 0.0, 0.0], [0.0, 0.0, 0.5]])
    one, other = (fit_noisy_response([(each, y)], RATE_HZ) for each in (u, u @ turn.T))
    assert one is not None
    assert other is not None
    assert other.gain @ turn == pytest.approx(one.gain, abs=1e-6)
    assert other.own == pytest.approx(one.own, abs=1e-6)
    assert other.error == pytest.approx(one.error, rel=1e-6)
