"""A servo with a mass that touches: the environment's force acts in each of its physics steps."""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from typing import Final, NamedTuple

import numpy as np

from tis.common.servo import servo_transition
from tis.common.units import NS_PER_S
from tis.common.vector import ZERO, Vector, minus, plus, scaled
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.environment import Environment
from tis.patient_side.plant.protocol import PlantOutput, Reference

_STEP_NS: Final = 250_000
"""Longest step of the physics: a force is held for that time."""


class TouchingState(NamedTuple):
    """Position in m, velocity in m/s, the set point in m in force since ``t_ns``, and a point of the surface in m."""

    position_m: Vector
    velocity_m_s: Vector
    reference_m: Vector
    t_ns: int
    surface_m: Vector


@dataclass(frozen=True)
class TouchingServo:
    """``m x'' = m w^2 (r - x) - 2 zeta w m x' + F`` on each axis; it starts at rest at the first reference.

    A step is exact for a constant force, which is that at the middle of the step. Without contact it moves as the
    servo without a mass. Oracles: static presses, and the differential equation solved numerically,
    test_touching_servo.
    """

    bandwidth_hz: float
    damping: float
    mass_kg: float
    environment: Environment
    sensor_error: Callable[[int], Array]

    @property
    def stiffness_n_m(self) -> float:
        """The spring between set point and arm."""
        return float(self.mass_kg * (2.0 * pi * self.bandwidth_hz) ** 2)

    def initial(self) -> TouchingState | None:
        """Return the state before the first reference: none."""
        return None

    def step(
        self, state: TouchingState | None, reference: Reference | None, tick: int, now_ns: int
    ) -> tuple[TouchingState | None, PlantOutput | None]:
        """Return the servo at ``now_ns``, moved from the last tick's state towards the last reference."""
        if state is None:
            if reference is None:
                return None, None
            x, y, z = reference.position_m.tolist()
            first = (x, y, z)
            state = TouchingState(first, ZERO, first, now_ns, self.environment.surface_m(first))
        target, surface = state.reference_m, state.surface_m
        position, velocity = self._moved(state, now_ns - state.t_ns)
        if reference is not None:
            x, y, z = reference.position_m.tolist()
            target = (x, y, z)
        place, force = np.array(position), self.environment.force(surface, position, velocity)
        output = PlantOutput(place, place + self.sensor_error(tick), force_n=force)
        return TouchingState(position, velocity, target, now_ns, surface), output

    def _moved(self, state: TouchingState, for_ns: int) -> tuple[Vector, Vector]:
        position, velocity, target = state.position_m, state.velocity_m_s, state.reference_m
        if for_ns <= 0:
            return position, velocity
        n = -(-for_ns // _STEP_NS)
        step_s = for_ns / n / NS_PER_S
        (stay, drift), (pull, keep) = servo_transition(self.bandwidth_hz, self.damping, step_s).tolist()
        compliance, surface, force_at = 1.0 / self.stiffness_n_m, state.surface_m, self.environment.force
        for _ in range(n):
            middle = plus(position, scaled(velocity, 0.5 * step_s))
            rest = plus(target, scaled(force_at(surface, middle, velocity), compliance))
            error = minus(position, rest)
            position, velocity = (
                plus(rest, plus(scaled(error, stay), scaled(velocity, drift))),
                plus(scaled(error, pull), scaled(velocity, keep)),
            )
        return position, velocity
