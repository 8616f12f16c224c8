"""The arm of a scenario: recorded, a servo on each axis, or simulated; and movements that it executes."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtri

from tis.common.channels import Arm
from tis.common.errors import Fault, InputError
from tis.common.scenario import Scenario
from tis.common.scenario.patient import MujocoPlant
from tis.common.scenario.patient import Plant as PlantPart
from tis.common.scenario.touch import TouchPart
from tis.common.servo import servo_transition
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.common.streams import Stream
from tis.common.units import MM_PER_M, NS_PER_S, sample_instant_ns
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import INSERTION, N_JOINTS
from tis.patient_side.plant.environment import Environment, environment_of
from tis.patient_side.plant.physics import ArmPhysics
from tis.patient_side.plant.protocol import Plant, PlantOutput, Reference
from tis.patient_side.plant.simulated_arm import SimulatedArm
from tis.patient_side.plant.touching_servo import TouchingServo
from tis.patient_side.rotations import after_turn, turn_to


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
        reference: Reference | None,  # noqa: ARG002
        tick: int,  # noqa: ARG002
        now_ns: int,
    ) -> tuple[None, PlantOutput]:
        """Return the recorded arm, interpolated linearly and constant beyond its ends."""
        at = ((now_ns + 1) * self.rate_hz - 1) // NS_PER_S if now_ns > 0 else 0
        orientation, gripper_rad = self.orientation, self.gripper_rad
        if at >= len(self.recorded_m) - 1:
            position = self.recorded_m[-1]
            turned_to = None if orientation is None else orientation[-1]
            angle_rad = None if gripper_rad is None else float(gripper_rad[-1])
            return None, PlantOutput(position, position, turned_to, angle_rad)
        # Plain numbers: on so few of them Python is faster than numpy.
        here, there = self.recorded_m[at : at + 2].tolist()
        begun_ns = sample_instant_ns(at, self.rate_hz)
        period_ns, since_ns = sample_instant_ns(at + 1, self.rate_hz) - begun_ns, max(now_ns - begun_ns, 0)
        position = np.array([(b - a) / period_ns * since_ns + a for a, b in zip(here, there, strict=True)])
        share = since_ns / period_ns
        turned_to = angle_rad = None
        if orientation is not None:
            a, b = map(tuple, orientation[at : at + 2].tolist())
            x, y, z = turn_to(a, b)
            turned_to = np.array(after_turn(a, (share * x, share * y, share * z)))
        if gripper_rad is not None:
            angle_rad = (1.0 - share) * gripper_rad.item(at) + share * gripper_rad.item(at + 1)
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
        return new_state, PlantOutput(position, position + self.sensor_error(tick))

    def sensor_error(self, tick: int) -> Array:
        """Return the error (3,) of the measured position at a tick, in m."""
        if self.sensor_noise_m == 0.0:
            return np.zeros(3)
        return np.asarray(self.sensor_noise_m * ndtri(self.noise.uniforms(3 * tick, 3)))


def build_plant(scenario: Scenario, recording: Recording, hand: HandRecording) -> Plant:
    """Return the scenario's arm; sample 0 of the run is row ``recording.start``.

    Raises `InputError` where a package is missing that simulates it.
    """
    spec = scenario.patient.plant
    if spec.kind == "replay":
        arm = hand.follower.rows(recording.start, len(hand.follower))
        return ReplayPlant(arm.position_m, recording.rate_hz, arm.orientation, arm.gripper_rad)
    return executing_plant(spec, scenario.seed, hand.arm, scenario.touch)


def executing_plant(spec: PlantPart, seed: int, arm: Arm, touch: TouchPart | None = None) -> Plant:
    """Return an arm that executes set points here; raises `InputError` for a replay and for an external arm."""
    if spec.kind == "replay" or spec.kind == "external":
        rule = "must be servo or mujoco for an arm that executes movements here"
        raise InputError(Fault("patient.plant", "kind", rule, spec.kind))
    noise = Stream.named(seed, noise_label(arm))
    if spec.kind == "mujoco":
        return simulated_arm(spec, noise, None if touch is None else environment_of(touch.environment))
    servo = ServoPlant(
        bandwidth_hz=spec.bandwidth_hz,
        damping=spec.damping,
        sensor_noise_m=spec.sensor_noise_mm / MM_PER_M,
        noise=noise,
    )
    if touch is None:
        return servo
    environment = environment_of(touch.environment)
    return TouchingServo(spec.bandwidth_hz, spec.damping, spec.moved_mass_kg, environment, servo.sensor_error)


def simulated_arm(spec: MujocoPlant, noise: Stream, environment: Environment | None = None) -> SimulatedArm:
    """Return the simulated arm, whose encoders have the noise of a stream; raises `InputError` without MuJoCo."""
    std = np.full(N_JOINTS, spec.encoder_noise_mrad / 1000.0)
    std[INSERTION] = spec.encoder_noise_mm / MM_PER_M
    return SimulatedArm(ArmPhysics(spec), spec.physics_hz, spec.insertion_m, std, noise, environment)


def noise_label(arm: Arm) -> str:
    """Return the label of the stream that an arm's sensor noise is drawn from."""
    return f"plant/{arm}/noise"


def executed(recording: Recording, scenario: Scenario, seed: int) -> Recording:
    """Return a recording whose arms are those of the scenario's plant, as their sensors measure them.

    The recorded poses of the arm are the set points, one for each row, and row k holds where the arm is when it gets
    set point k. Command and arm are then related as in a run: the arm's dynamics lie between them.

    Parameters
    ----------
    recording
        The movements.
    scenario
        Its ``patient.plant`` is the arm, which must not be a replay.
    seed
        Seed of the arm's sensor noise.

    Returns
    -------
    Recording
        The same commands, and the arms that followed.

    Notes
    -----
    Raises `InputError` where a package is missing that simulates the arm. Oracle: the servo's discrete-time system,
    test_execution.
    """
    hands = tuple(
        replace(hand, follower=_followed(hand, scenario, seed, recording.rate_hz)) for hand in recording.hands
    )
    return replace(recording, hands=hands)


def _followed(hand: HandRecording, scenario: Scenario, seed: int, rate_hz: int) -> PoseTrack:
    plant, wanted = executing_plant(scenario.patient.plant, seed, hand.arm), hand.follower
    found = PoseTrack(
        *(np.empty_like(values) for values in (wanted.position_m, wanted.orientation, wanted.gripper_rad))
    )
    state = plant.initial()
    rows = zip(wanted.position_m, wanted.orientation, wanted.gripper_rad, strict=True)
    for k, (place_m, orientation, gripper_rad) in enumerate(rows):
        state, moved = plant.step(
            state, Reference(place_m, orientation, float(gripper_rad)), k, sample_instant_ns(k, rate_hz)
        )
        assert moved is not None, "every row has a set point"
        found.position_m[k] = moved.measured_m
        found.orientation[k] = orientation if moved.orientation is None else moved.orientation
        found.gripper_rad[k] = gripper_rad if moved.gripper_rad is None else moved.gripper_rad
    return found
