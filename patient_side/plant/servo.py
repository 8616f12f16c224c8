"""A simulated servo on each axis, which executes the set points."""

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri

from tis.common.servo import servo_transition
from tis.common.streams import Stream
from tis.common.units import NS_PER_S
from tis.patient_side.plant.protocol import PlantOutput, Reference
from tis.patient_side.statespace import Array


@dataclass(frozen=True)
class ServoState:
    """Position (3,) in m, velocity (3,) in m/s and the reference (3,) in m in force since ``t_ns``."""

    position_m: Array
    velocity_m_s: Array
    reference_m: Array
    t_ns: int


@dataclass(frozen=True)
class ServoPlant:
    """A second-order servo on each axis, ``x'' = w^2 (r - x) - 2 zeta w x'``, with normal sensor noise.

    It starts at rest at the first reference. The noise of axis a at tick k is element ``3 k + a`` of the
    stream. Oracles: the differential equation solved numerically, and the matrix exponential.
    """

    bandwidth_hz: float
    damping: float
    sensor_noise_m: float
    noise: Stream

    def initial(self) -> ServoState | None:
        """Return the state before the first reference: none."""
        return None

    def step(
        self, state: ServoState | None, reference: Reference | None, tick: int, now_ns: int
    ) -> tuple[ServoState | None, PlantOutput | None]:
        """Return the servo at ``now_ns``, moved from the last tick's state towards the last reference."""
        if state is None:
            if reference is None:
                return None, None
            state = ServoState(reference.position_m, np.zeros(3), reference.position_m, now_ns)
        move = servo_transition(self.bandwidth_hz, self.damping, (now_ns - state.t_ns) / NS_PER_S)
        error = state.position_m - state.reference_m
        position = state.reference_m + move[0, 0] * error + move[0, 1] * state.velocity_m_s
        velocity = move[1, 0] * error + move[1, 1] * state.velocity_m_s
        target_m = state.reference_m if reference is None else reference.position_m
        new_state = ServoState(position, velocity, target_m, now_ns)
        return new_state, PlantOutput(position, position + self._sensor_error(tick))

    def _sensor_error(self, tick: int) -> Array:
        if self.sensor_noise_m == 0.0:
            return np.zeros(3)
        return np.asarray(self.sensor_noise_m * ndtri(self.noise.uniforms(3 * tick, 3)))
