"""The servo with a mass: static presses in closed form, its movement against a solver, and free movement."""

from math import pi

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tis.common.scenario.touch import Environment, TissueEnvironment, WallEnvironment
from tis.common.streams import Stream
from tis.patient_side.plant.build import ServoPlant
from tis.patient_side.plant.environment import Tissue, environment_of
from tis.patient_side.plant.protocol import Reference
from tis.patient_side.plant.touching_servo import TouchingServo, TouchingState


def _no_error(_: int) -> NDArray[np.float64]:
    return np.zeros(3)


def _servo(
    environment: Environment, mass_kg: float = 0.3, bandwidth_hz: float = 6.0, damping: float = 1.0
) -> TouchingServo:
    return TouchingServo(bandwidth_hz, damping, mass_kg, environment_of(environment), _no_error)


def _pressed(servo: TouchingServo, to_m: float, n: int = 3000) -> TouchingState:
    """Return the arm that stood at 0 and was led to ``to_m`` along z."""
    state, _ = servo.step(None, Reference(np.zeros(3)), 0, 0)
    for k in range(1, n):
        state, _ = servo.step(state, Reference(np.array([0.0, 0.0, to_m])), k, k * 1_000_000)
    assert state is not None
    return state


@pytest.mark.parametrize("mass_kg", [0.1, 0.3, 1.0])
@pytest.mark.parametrize("stiffness_n_m", [1000.0, 3000.0, 10_000.0])
def test_a_static_press_is_stiffness_times_depth_whatever_the_mass(mass_kg: float, stiffness_n_m: float) -> None:
    servo = _servo(WallEnvironment(kind="wall", distance_mm=2, stiffness_n_m=stiffness_n_m), mass_kg)
    state = _pressed(servo, -0.01)
    depth = -0.002 - state.position_m[2]
    force = servo.environment.force(state.surface_m, state.position_m, state.velocity_m_s)[2]
    assert force == pytest.approx(stiffness_n_m * depth, rel=5e-3)
    # and the spring of the servo holds against it
    assert force == pytest.approx(servo.stiffness_n_m * (state.position_m[2] + 0.01), rel=5e-3)


def test_tissue_is_pressed_along_its_curve() -> None:
    part = TissueEnvironment(kind="tissue", distance_mm=0)
    for to_m in (-0.001, -0.003, -0.008):
        servo = _servo(part)
        state = _pressed(servo, to_m)
        depth = -state.position_m[2]
        found = servo.stiffness_n_m * (state.position_m[2] - to_m)
        assert found == pytest.approx(Tissue.of(part).k * depth**1.5, rel=1e-2)


def test_hitting_a_wall_goes_as_the_differential_equation_says() -> None:
    part = WallEnvironment(kind="wall", distance_mm=1, stiffness_n_m=1500, damping_ns_m=3)
    servo = _servo(part, 0.3, 6.0, 0.4)
    w = 2 * pi * 6.0

    def motion(_: float, y: NDArray[np.float64]) -> list[float]:
        depth = -0.001 - y[0]
        force = max(0.0, 1500 * depth - 3 * y[1]) if depth > 0 else 0.0
        return [y[1], w * w * (-0.006 - y[0]) - 0.8 * w * y[1] + force / 0.3]

    state = _pressed(servo, -0.006, 2)
    for k in range(2, 402):
        after, _ = servo.step(state, None, k, k * 1_000_000)
        assert after is not None
        state = after
    exact = solve_ivp(motion, (0.0, 0.4), [0.0, 0.0], rtol=1e-9, atol=1e-12, max_step=1e-4).y[:, -1]
    assert state.position_m[2] == pytest.approx(exact[0], rel=2e-3)


def test_without_contact_it_moves_as_the_servo_without_a_mass() -> None:
    far = _servo(WallEnvironment(kind="wall", distance_mm=900), 0.3, 6.0, 0.7)
    plain = ServoPlant(6.0, 0.7, 0.0, Stream.named(1, "x"))
    one, other = far.initial(), plain.initial()
    for k in range(60):
        reference = Reference(np.array([0.01 * np.sin(k / 5), 0.0, 0.002 * k]))
        one, moved = far.step(one, reference, k, k * 33_000_000)
        other, wanted = plain.step(other, reference, k, k * 33_000_000)
        assert moved is not None
        assert wanted is not None
        assert moved.position_m == pytest.approx(wanted.position_m, abs=1e-12)
        assert moved.force_n == (0.0, 0.0, 0.0)
