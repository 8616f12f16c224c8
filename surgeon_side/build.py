"""The surgeon's node from a scenario and a recording."""

from tis.common.scenario import Scenario
from tis.common.sources.sensor_noise import SensorNoise
from tis.common.sources.trajectory import Recording
from tis.common.ticker import Ticker
from tis.common.units import MM_PER_M, ms_to_ns
from tis.surgeon_side.commanded_arm import Servo
from tis.surgeon_side.live import LiveMotion
from tis.surgeon_side.motion import Motion, RecordedMotion
from tis.surgeon_side.node import Redundancy, SurgeonNode
from tis.surgeon_side.touch import YieldingMotion, build_touch
from tis.surgeon_side.witness import WitnessNode


def build_surgeon(scenario: Scenario, recording: Recording) -> SurgeonNode:
    """Return a surgeon that plays the recording's rows from its start, or follows a live source's devices."""
    part = scenario.surgeon
    redundancy = Redundancy(part.copies, ms_to_ns(part.copy_spacing_ms), part.history)
    ticker = Ticker(scenario.rate_hz, scenario.n_samples)
    source = scenario.source
    motion: Motion = LiveMotion(source, scenario.rate_hz) if source.kind == "live" else RecordedMotion(recording)
    noise, servo, touch = sensor_noise(scenario), known_servo(scenario), build_touch(scenario, recording)
    if touch is not None and scenario.simulates_hand:
        motion = YieldingMotion(motion, touch.hands)
    is_forged = not scenario.network.corrupts("feedback")
    return SurgeonNode(
        scenario.session,
        motion,
        ticker,
        redundancy,
        noise=noise,
        servo=servo,
        touch=touch,
        changes_are_forged=is_forged,
    )


def build_witness(scenario: Scenario, movement: Recording) -> WitnessNode:
    """Return the witness of a foreign surgeon that moves the hands of ``movement``."""
    hands = [hand.channels for hand in movement.hands]
    return WitnessNode(scenario.session, hands, scenario.rate_hz, scenario.n_samples)


def sensor_noise(scenario: Scenario) -> SensorNoise | None:
    """Return the noise of the scenario's sensors, None without any."""
    std_mm = scenario.surgeon.sensor_noise_mm
    return SensorNoise(scenario.seed, std_mm / MM_PER_M) if std_mm else None


def known_servo(scenario: Scenario) -> Servo | None:
    """Return the servo of the patient's arm, None where the arm is another one."""
    plant = scenario.patient.plant
    return Servo(plant.bandwidth_hz, plant.damping) if plant.kind == "servo" else None
