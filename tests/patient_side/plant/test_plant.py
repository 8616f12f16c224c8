from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation, Slerp
from scipy.stats import kstest

from tis.common.channels import Arm
from tis.common.scenario import Scenario
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.common.streams import Stream
from tis.common.units import sample_instant_ns
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.build import ReplayPlant, ServoPlant, build_plant, noise_label
from tis.patient_side.plant.protocol import Reference

NOISE = Stream.named(1, noise_label("PSM2"))


def servo(noise_m: float = 0.0, damping: float = 0.7) -> ServoPlant:
    return ServoPlant(bandwidth_hz=2.0, damping=damping, sensor_noise_m=noise_m, noise=NOISE)


def test_replay_turns_at_a_constant_speed_between_samples() -> None:
    angles = np.radians([0.0, 40.0, 170.0, 200.0])
    rotations = Rotation.from_rotvec(angles[:, None] * [0.0, 0.6, 0.8])
    orientation = rotations.as_quat() * [[1.0], [-1.0], [1.0], [1.0]]  # signs do not matter
    plant = ReplayPlant(np.zeros((4, 3)), 10, orientation, np.array([0.0, 0.2, 0.1, 0.5]))
    slerp = Slerp([0.0, 0.1, 0.2, 0.3], rotations)
    for now_ns in (0, 30_000_000, 100_000_000, 250_000_000, 10**9):
        _, output = plant.step(None, None, 0, now_ns)
        assert output.orientation is not None
        expected = slerp(min(now_ns / 1e9, 0.3))
        assert (Rotation.from_quat(output.orientation).inv() * expected).magnitude() < 1e-7
        assert output.gripper_rad == pytest.approx(np.interp(now_ns / 1e9, [0, 0.1, 0.2, 0.3], [0.0, 0.2, 0.1, 0.5]))


def recording(n: int, start: int, arm: Arm = "PSM2") -> Recording:
    positions = np.arange(3 * n, dtype=float).reshape(n, 3)
    track = PoseTrack(positions, np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)), np.zeros(n))
    return Recording("made up", 30, (HandRecording("left", arm, track, track),), start, "cross")


def scenario(plant: dict[str, object]) -> Scenario:
    return Scenario.model_validate(
        {"version": 1, "name": "t", "seed": 5, "source": {"kind": "synthetic"}, "patient": {"plant": plant}}
    )


def test_replay_interpolates_between_sample_instants_and_stays_at_its_ends() -> None:
    plant = ReplayPlant(np.array([[0.0, 1.0, 2.0], [3.0, 1.0, 0.0]]), rate_hz=10)
    for now_ns, expected in [
        (0, [0, 1, 2]),
        (25_000_000, [0.75, 1, 1.5]),
        (100_000_000, [3, 1, 0]),
        (10**9, [3, 1, 0]),
    ]:
        _, output = plant.step(None, None, 0, now_ns)
        assert output.position_m == pytest.approx(expected)
        assert output.measured_m == pytest.approx(expected)


@pytest.mark.parametrize("rate_hz", [30, 1000])
def test_replay_is_numpys_interpolation_to_the_last_bit(rate_hz: int) -> None:
    rng = np.random.default_rng(rate_hz)
    recorded_m = rng.normal(size=(40, 3))
    plant = ReplayPlant(recorded_m, rate_hz)
    instants = [sample_instant_ns(i, rate_hz) for i in range(40)]
    beside = [t + step for t in instants for step in (-1, 0, 1)]
    for now_ns in [*beside, *rng.integers(0, instants[-1], 50)]:
        expected = [np.interp(now_ns, instants, axis) for axis in recorded_m.T]
        assert plant.step(None, None, 0, int(now_ns))[1].position_m.tolist() == expected


@pytest.mark.parametrize("damping", [0.3, 1.0, 2.0])
def test_servo_solves_its_differential_equation(damping: float) -> None:
    ticks_ns = [0, 33_333_333, 66_666_666, 200_000_000, 233_333_333]  # ticks were missed in between
    references = [np.array([0.1, 0.0, -0.2]), np.array([0.2, 0.1, 0.0]), None, np.array([0.0, 0.0, 0.0]), None]
    plant = servo(damping=damping)
    state, w = plant.initial(), 2 * np.pi * 2.0
    z, held = np.concatenate([[0.1, 0.0, -0.2], np.zeros(3)]), np.array([0.1, 0.0, -0.2])
    for k, (now_ns, reference) in enumerate(zip(ticks_ns, references, strict=True)):
        state, output = plant.step(state, None if reference is None else Reference(reference), k, now_ns)
        if k:

            def motion(_: float, s: Array, r: Array = held) -> Array:
                return np.concatenate([s[3:], w**2 * (r - s[:3]) - 2 * damping * w * s[3:]])

            span = (ticks_ns[k - 1] / 1e9, now_ns / 1e9)
            z = solve_ivp(motion, span, z, rtol=1e-10, atol=1e-12).y[:, -1]
        held = held if reference is None else reference
        assert output is not None
        assert output.position_m == pytest.approx(z[:3], abs=1e-9)
        assert output.measured_m == pytest.approx(output.position_m)


def test_servo_waits_for_a_reference_and_begins_there_at_rest() -> None:
    plant = servo()
    state, output = plant.step(plant.initial(), None, 0, 0)
    assert state is None
    assert output is None
    target = np.array([0.1, 0.2, 0.3])
    for k in range(1, 4):
        state, output = plant.step(state, Reference(target), k, k * 33_333_333)
        assert output is not None
        assert output.position_m == pytest.approx(target, abs=1e-15)


def test_sensor_noise_belongs_to_the_tick_and_is_normal() -> None:
    plant, target = servo(noise_m=1e-3), Reference(np.zeros(3))
    state, _ = plant.step(None, target, 0, 0)
    errors = []
    for k in range(1, 1500):
        _, output = plant.step(state, target, k, k)
        assert output is not None
        errors.append(output.measured_m - output.position_m)
    _, again = plant.step(state, target, 700, 700)
    assert again is not None
    assert np.array_equal(again.measured_m, errors[699])
    assert kstest(np.concatenate(errors) / 1e-3, "norm").pvalue > 0.01


def test_replay_begins_at_the_first_row_of_the_run() -> None:
    source = recording(10, start=4)
    plant = build_plant(scenario({"kind": "replay"}), source, source.hands[0])
    _, output = plant.step(plant.initial(), None, 0, 0)
    assert output is not None
    assert output.position_m == pytest.approx([12.0, 13.0, 14.0])


def test_servo_takes_the_scenario_s_units_and_a_stream_of_its_own() -> None:
    source = recording(10, start=0)
    spec: dict[str, object] = {"kind": "servo", "bandwidth_hz": 5.0, "damping": 0.8, "sensor_noise_mm": 0.5}
    plant = build_plant(scenario(spec), source, source.hands[0])
    assert isinstance(plant, ServoPlant)
    assert (plant.bandwidth_hz, plant.damping, plant.sensor_noise_m) == (5.0, 0.8, 0.0005)
    other = build_plant(scenario(spec), source, replace(source.hands[0], arm="PSM1"))
    assert isinstance(other, ServoPlant)
    assert plant.noise.uniform(0) == Stream.named(5, "plant/PSM2/noise").uniform(0) != other.noise.uniform(0)
