"""The arm of a scenario."""

import numpy as np

from tis.common.channels import Arm
from tis.common.errors import Fault, InputError
from tis.common.scenario import Scenario
from tis.common.scenario.patient import MujocoPlant
from tis.common.scenario.patient import Plant as PlantPart
from tis.common.sources.trajectory import HandRecording, Recording
from tis.common.streams import Stream
from tis.common.units import MM_PER_M
from tis.patient_side.plant.arm_geometry import INSERTION, N_JOINTS
from tis.patient_side.plant.physics import ArmPhysics
from tis.patient_side.plant.protocol import Plant
from tis.patient_side.plant.replay import ReplayPlant
from tis.patient_side.plant.servo import ServoPlant
from tis.patient_side.plant.simulated_arm import SimulatedArm


def build_plant(scenario: Scenario, recording: Recording, hand: HandRecording) -> Plant:
    """Return the scenario's arm; sample 0 of the run is row ``recording.start``.

    Raises `InputError` where a package is missing that simulates it.
    """
    spec = scenario.patient.plant
    if spec.kind == "replay":
        arm = hand.follower.rows(recording.start, len(hand.follower))
        return ReplayPlant(arm.position_m, recording.rate_hz, arm.orientation, arm.gripper_rad)
    return executing_plant(spec, scenario.seed, hand.arm)


def executing_plant(spec: PlantPart, seed: int, arm: Arm) -> Plant:
    """Return an arm that executes set points here; raises `InputError` for a replay and for an external arm."""
    if spec.kind == "replay" or spec.kind == "external":
        rule = "must be servo or mujoco for an arm that executes movements here"
        raise InputError(Fault("patient.plant", "kind", rule, spec.kind))
    noise = Stream.named(seed, noise_label(arm))
    if spec.kind == "mujoco":
        return simulated_arm(spec, noise)
    return ServoPlant(
        bandwidth_hz=spec.bandwidth_hz,
        damping=spec.damping,
        sensor_noise_m=spec.sensor_noise_mm / MM_PER_M,
        noise=noise,
    )


def simulated_arm(spec: MujocoPlant, noise: Stream) -> SimulatedArm:
    """Return the simulated arm, whose encoders have the noise of a stream; raises `InputError` without MuJoCo."""
    std = np.full(N_JOINTS, spec.encoder_noise_mrad / 1000.0)
    std[INSERTION] = spec.encoder_noise_mm / MM_PER_M
    return SimulatedArm(ArmPhysics(spec), spec.physics_hz, spec.insertion_m, std, noise)


def noise_label(arm: Arm) -> str:
    """Return the label of the stream that an arm's sensor noise is drawn from."""
    return f"plant/{arm}/noise"
