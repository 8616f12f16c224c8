"""The response of an arm to its command: responses that are known, and servos."""

import numpy as np
import pytest

from tis.common.scenario.source import SyntheticSource
from tis.common.sources.synthetic import synthesise
from tis.patient_side.identification.arm_response import fit_response
from tis.patient_side.linear_system import Array
from tis.patient_side.movement_models import ArmResponse

TURN = np.array([[0.0, 0.5, 0.0], [-0.5, 0.0, 0.0], [0.0, 0.0, 0.4]])
OWN, COMMAND = np.array([0.5, 0.2, -0.1, 0.05]), np.array([0.1, 0.1, 0.1, 0.04, 0.01])


def response_to(u: Array, own: Array) -> Array:
    du = np.diff(u @ TURN.T, axis=0)
    dy = np.zeros_like(du)
    for k in range(len(du)):
        dy[k] = sum((COMMAND[i] * du[k - i] for i in range(5) if k >= i), np.zeros(3))
        dy[k] += sum((own[i] * dy[k - 1 - i] for i in range(4) if k > i), np.zeros(3))
    return np.vstack([np.zeros(3), np.cumsum(dy, axis=0)]) + 0.2


def walk(seed: int) -> Array:
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(size=(500, 3)), axis=0) * 1e-3


def found(trials: list[tuple[Array, Array]]) -> ArmResponse:
    response = fit_response(trials, 30)
    assert response is not None
    return response


def test_a_response_that_is_known_is_found_about_any_point_and_in_any_direction() -> None:
    trials = [(walk(seed), response_to(walk(seed), OWN)) for seed in (1, 2)]
    response = found(trials)
    assert response.own == pytest.approx(OWN, abs=1e-3)
    # gain and coefficients share a factor
    assert response.gain * response.command.sum() == pytest.approx(TURN * COMMAND.sum(), abs=1e-3)
    assert response.noise < 1e-6 * np.mean(np.diff(trials[0][1], axis=0) ** 2)
    again = found(trials)
    assert (again.gain == response.gain).all()


def test_a_response_that_runs_away_is_none() -> None:
    assert fit_response([(walk(3), response_to(walk(3), np.array([1.2, 0.0, 0.0, 0.0])))], 30) is None


@pytest.mark.parametrize("bandwidth_hz", [1.0, 2.0, 8.0])
def test_a_servo_is_run_on_by_its_response(bandwidth_hz: float) -> None:
    """Simulated for a second from known increments and offset, it stays within 1 % of the arm's move."""
    source = SyntheticSource(kind="synthetic", arm_bandwidth_hz=bandwidth_hz, recorder_hz=None)
    hand = synthesise(source, 5, 30, 3000, 0).hands[0]
    u, y = hand.command.position_m, hand.follower.position_m
    response = found([(u[:2400], y[:2400])])
    p = u @ response.gain.T
    dp, dy, offset = np.diff(p, axis=0), np.diff(y, axis=0), np.mean((y - p)[:2400], axis=0)
    errors, moves = [], []
    for first in range(2400, 2960, 30):
        past, arm = list(dy[first - 4 : first]), y[first]
        for k in range(first, first + 30):
            move = response.pull * (p[k] + offset - arm)
            move += sum((a * past[-1 - i] for i, a in enumerate(response.own)), np.zeros(3))
            move += sum((b * dp[k - i] for i, b in enumerate(response.command)), np.zeros(3))
            past.append(move)
            arm = arm + move
        moves.append(dy[first : first + 30].sum(axis=0))
        errors.append(arm - y[first + 30])
    assert np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(moves))) < 0.01


def test_an_arm_that_knows_no_place_has_no_pull() -> None:
    """Its increments alone follow the command's, and the two drift apart."""
    rng = np.random.default_rng(3)
    trials = [(walk(s), response_to(walk(s), OWN) + np.cumsum(rng.normal(size=(500, 3)), 0) * 1e-4) for s in (1, 2)]
    assert found(trials).pull == 0.0
