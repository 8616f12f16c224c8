"""The arm at the patient: the recorded one, or a simulated servo that executes the active estimate."""

from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.special import ndtri

from common.channels import Arm
from common.scenario import Scenario
from common.servo import servo_transition
from common.sources.trajectory import HandRecording, Recording
from common.streams import Stream
from common.units import MM_PER_M, NS_PER_S, sample_instant_ns
from patient_side.rotations import turned, turned_by
from patient_side.statespace import Array


class PlantOutput(NamedTuple):
    """The arm's position (3,) in m, and its position as measured by its sensors.

    ``orientation`` (4,) is a unit quaternion x, y, z, w; None where the arm takes that of its set point, as it does
    with the gripper, in rad.
    """

    position_m: Array
    measured_m: Array
    orientation: Array | None = None
    gripper_rad: float | None = None


class Plant(Protocol):
    """Frozen parameters, an initial state, and a pure step from tick to tick."""

    def initial(self) -> Any:
        """Return the state before the first tick."""
        ...

    def step(self, state: Any, reference_m: Array | None, tick: int, now_ns: int) -> tuple[Any, PlantOutput | None]:
        """Return the new state and the arm at ``now_ns``; None before the first reference of a servo.

        ``reference_m`` (3,) holds from now until the next tick; None keeps the last one.
        """
        ...


@dataclass(frozen=True)
class ReplayPlant:
    """The arm follows the recorded arm: positions (N, 3) in m at the sample instants of ``rate_hz``.

    ``orientation`` (N, 4) and ``gripper_rad`` (N,), where they are known, are interpolated likewise, the orientation
    at a constant rotation speed. A tick reads two rows, however long the recording is. Oracles: numpy's
    interpolation, SciPy's Slerp.
    """

    recorded_m: Array
    rate_hz: int
    orientation: Array | None = None
    gripper_rad: Array | None = None

    def initial(self) -> None:
        """Return the state: there is none."""

    def step(
        self,
        state: None,  # noqa: ARG002  part of the protocol; a recording needs none of these
        reference_m: Array | None,  # noqa: ARG002
        tick: int,  # noqa: ARG002
        now_ns: int,
    ) -> tuple[None, PlantOutput]:
        """Return the recorded arm, interpolated linearly and constant beyond its ends."""
        at = max(((now_ns + 1) * self.rate_hz - 1) // NS_PER_S, 0)
        orientation, gripper_rad = self.orientation, self.gripper_rad
        if at >= len(self.recorded_m) - 1:
            position = self.recorded_m[-1]
            turned_to = None if orientation is None else orientation[-1]
            angle_rad = None if gripper_rad is None else float(gripper_rad[-1])
            return None, PlantOutput(position, position, turned_to, angle_rad)
        here, there = self.recorded_m[at], self.recorded_m[at + 1]
        begun_ns = sample_instant_ns(at, self.rate_hz)
        period_ns, since_ns = sample_instant_ns(at + 1, self.rate_hz) - begun_ns, max(now_ns - begun_ns, 0)
        speed = (there - here) / period_ns
        position = speed * since_ns + here
        share = since_ns / period_ns
        turned_to = angle_rad = None
        if orientation is not None:
            turned_to = turned_by(orientation[at], share * turned(orientation[at], orientation[at + 1]))
        if gripper_rad is not None:
            angle_rad = float((1.0 - share) * gripper_rad[at] + share * gripper_rad[at + 1])
        return None, PlantOutput(position, position, turned_to, angle_rad)


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
        self, state: ServoState | None, reference_m: Array | None, tick: int, now_ns: int
    ) -> tuple[ServoState | None, PlantOutput | None]:
        """Return the servo at ``now_ns``, moved from the last tick's state towards the last reference."""
        if state is None:
            if reference_m is None:
                return None, None
            state = ServoState(reference_m, np.zeros(3), reference_m, now_ns)
        move = servo_transition(self.bandwidth_hz, self.damping, (now_ns - state.t_ns) / NS_PER_S)
        error = state.position_m - state.reference_m
        position = state.reference_m + move[0, 0] * error + move[0, 1] * state.velocity_m_s
        velocity = move[1, 0] * error + move[1, 1] * state.velocity_m_s
        reference = state.reference_m if reference_m is None else reference_m
        new_state = ServoState(position, velocity, reference, now_ns)
        return new_state, PlantOutput(position, position + self._sensor_error(tick))

    def _sensor_error(self, tick: int) -> Array:
        if self.sensor_noise_m == 0.0:
            return np.zeros(3)
        return np.asarray(self.sensor_noise_m * ndtri(self.noise.uniforms(3 * tick, 3)))


def build_plant(scenario: Scenario, recording: Recording, hand: HandRecording) -> Plant:
    """Return the scenario's arm; sample 0 of the run is row ``recording.start``."""
    spec = scenario.patient.plant
    if spec.kind == "replay":
        arm = hand.follower.rows(recording.start, len(hand.follower))
        return ReplayPlant(arm.position_m, recording.rate_hz, arm.orientation, arm.gripper_rad)
    assert spec.kind == "servo"
    return ServoPlant(
        bandwidth_hz=spec.bandwidth_hz,
        damping=spec.damping,
        sensor_noise_m=spec.sensor_noise_mm / MM_PER_M,
        noise=Stream.named(scenario.seed, noise_label(hand.arm)),
    )


def noise_label(arm: Arm) -> str:
    """Return the label of the stream that an arm's sensor noise is drawn from."""
    return f"plant/{arm}/noise"
