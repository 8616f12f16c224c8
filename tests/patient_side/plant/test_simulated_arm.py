import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import kstest

from tis.common.scenario.patient import MujocoPlant
from tis.common.scenario.touch import WallEnvironment
from tis.common.streams import Stream
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.build import simulated_arm
from tis.patient_side.plant.environment import environment_of
from tis.patient_side.plant.protocol import PlantOutput, Reference
from tis.patient_side.plant.simulated_arm import ArmState, SimulatedArm

pytest.importorskip("mujoco", reason="the extra sim is not installed")

TICK_NS = 33_333_333
FIRST_M = np.array([0.1, -0.05, 0.2])
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def an_arm(**fields: object) -> SimulatedArm:
    spec = MujocoPlant.model_validate({"kind": "mujoco", **fields})
    return simulated_arm(spec, Stream.named(1, "plant/PSM2/noise"))


def at(place_m: Array, vector: Array | None = None, gripper_rad: float = 0.2) -> Reference:
    return Reference(place_m, LEVEL if vector is None else Rotation.from_rotvec(vector).as_quat(), gripper_rad)


def beside(x_m: float, y_m: float, z_m: float) -> Array:
    return np.asarray(FIRST_M + np.array([x_m, y_m, z_m]))


def played(arm: SimulatedArm, references: list[Reference | None]) -> tuple[ArmState | None, list[PlantOutput]]:
    state, found = arm.initial(), []
    for k, reference in enumerate(references):
        state, output = arm.step(state, reference, k, k * TICK_NS)
        assert output is not None
        found.append(output)
    return state, found


def test_the_arm_waits_for_a_set_point_whose_orientation_is_known() -> None:
    arm = an_arm()
    assert arm.step(arm.initial(), None, 0, 0) == (None, None)
    assert arm.step(None, Reference(FIRST_M, None), 1, TICK_NS) == (None, None)
    state, output = arm.step(None, at(FIRST_M), 2, 2 * TICK_NS)
    assert state is not None
    assert output is not None
    assert output.position_m == pytest.approx(FIRST_M, abs=1e-12)
    assert output.gripper_rad == pytest.approx(0.2)


def test_the_arm_comes_to_rest_at_its_set_point_pose_and_gripper() -> None:
    target = at(beside(0.02, -0.03, 0.01), np.array([0.3, -0.4, 0.8]), 0.6)
    _, outputs = played(an_arm(friction=0), [at(FIRST_M), *[target] * 60])
    last = outputs[-1]
    assert not last.is_clamped
    assert last.position_m == pytest.approx(target.position_m, abs=1e-6)
    assert last.gripper_rad == pytest.approx(0.6, abs=1e-5)
    assert last.orientation is not None
    assert target.orientation is not None
    turn = Rotation.from_quat(last.orientation).inv() * Rotation.from_quat(target.orientation)
    assert turn.magnitude() < 1e-4


def test_friction_leaves_an_error_at_rest_that_the_loop_does_not_remove() -> None:
    target = at(beside(0.02, 0.0, 0.0))
    _, outputs = played(an_arm(friction=3), [at(FIRST_M), *[target] * 60])
    error_mm = 1000 * np.linalg.norm(outputs[-1].position_m - target.position_m)
    assert 0.001 < error_mm < 2.0


@pytest.mark.parametrize(("bandwidth_hz", "damping"), [(4.0, 1.0), (8.0, 0.7)])
def test_a_slow_movement_lags_by_twice_the_damping_over_the_frequency(bandwidth_hz: float, damping: float) -> None:
    # For a ramp a second-order loop lags by 2 zeta / w; set points that stand for a tick add half a tick.
    arm = an_arm(bandwidth_hz=bandwidth_hz, damping=damping, friction=0)
    speed_m_s = 0.01
    references: list[Reference | None] = [at(beside(0.0, speed_m_s * k * TICK_NS / 1e9, 0.0)) for k in range(90)]
    _, outputs = played(arm, references)
    behind_m = [89 * speed_m_s * TICK_NS / 1e9 - (outputs[-1].position_m - FIRST_M)[1]]
    lag_s = behind_m[0] / speed_m_s
    assert lag_s == pytest.approx(2 * damping / (2 * np.pi * bandwidth_hz), abs=0.02)


def test_a_set_point_out_of_reach_is_said_and_held_at_the_limit() -> None:
    far = at(beside(0.0, 0.0, 0.5))
    _, outputs = played(an_arm(), [at(FIRST_M), *[far] * 60, at(FIRST_M), *[at(FIRST_M)] * 60])
    # the set point in force until a tick is that of the tick before
    assert [output.is_clamped for output in outputs] == [False, *[False], *[True] * 60, *[False] * 60]
    assert np.linalg.norm(outputs[60].position_m - FIRST_M) < 0.2
    assert outputs[-1].position_m == pytest.approx(FIRST_M, abs=1e-3)


def test_equal_set_points_move_equal_arms_bit_for_bit() -> None:
    rng = np.random.default_rng(1)
    references: list[Reference | None] = [
        None if k and k % 7 == 3 else at(FIRST_M + rng.normal(0, 0.005, 3), rng.normal(0, 0.2, 3)) for k in range(80)
    ]
    fields = {"encoder_noise_mrad": 0.1, "encoder_noise_mm": 0.01}
    first, second = played(an_arm(**fields), references), played(an_arm(**fields), references)
    assert [o.measured_m.tobytes() for o in first[1]] == [o.measured_m.tobytes() for o in second[1]]
    assert first[0] is not None
    assert second[0] is not None
    assert first[0].physics.tobytes() == second[0].physics.tobytes()


def test_missed_ticks_leave_the_physics_as_it_is() -> None:
    arm, target = an_arm(), at(beside(0.01, 0.0, 0.0))
    _, often = played(arm, [at(FIRST_M), target, *[None] * 10])
    state, _ = arm.step(None, at(FIRST_M), 0, 0)
    state, _ = arm.step(state, target, 1, TICK_NS)
    _, once = arm.step(state, None, 11, 11 * TICK_NS)
    assert once is not None
    assert once.position_m.tobytes() == often[-1].position_m.tobytes()


def test_a_step_does_not_change_the_state_that_it_begins_with() -> None:
    arm = an_arm()
    state, _ = arm.step(None, at(FIRST_M), 0, 0)
    state, _ = arm.step(state, at(FIRST_M + 0.01), 1, TICK_NS)
    assert state is not None
    before = state.physics.copy()
    _, first = arm.step(state, None, 2, 2 * TICK_NS)
    _, again = arm.step(state, None, 2, 2 * TICK_NS)
    assert state.physics.tobytes() == before.tobytes()
    assert first is not None
    assert again is not None
    assert first.position_m.tobytes() == again.position_m.tobytes()


def test_encoder_noise_belongs_to_the_tick_and_is_normal_at_each_joint() -> None:
    arm = an_arm(encoder_noise_mm=0.5)  # the insertion alone: along the shaft, which hangs straight down at home
    state, _ = arm.step(None, at(FIRST_M), 0, 0)
    errors_m = []
    for k in range(1, 800):
        _, output = arm.step(state, at(FIRST_M), k, 0)
        assert output is not None
        errors_m.append(np.linalg.norm(output.measured_m - output.position_m))
        assert output.position_m == pytest.approx(FIRST_M, abs=1e-9)
    assert kstest(np.array(errors_m) / 0.5e-3, "halfnorm").pvalue > 0.01
    _, again = arm.step(state, at(FIRST_M), 400, 0)
    assert again is not None
    assert np.linalg.norm(again.measured_m - again.position_m) == errors_m[399]


@pytest.mark.parametrize("stiffness_n_m", [400.0, 3000.0])
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (1.0, 0.0, 1.0)])
def test_a_static_press_is_stiffness_times_depth_along_the_normal(
    stiffness_n_m: float, normal: tuple[float, float, float]
) -> None:
    """Through the joints, whatever they weigh; a wall turned by 45 degrees turns the force with it."""
    wall = WallEnvironment(kind="wall", normal=normal, distance_mm=1, stiffness_n_m=stiffness_n_m)
    spec = MujocoPlant.model_validate({"kind": "mujoco", "friction": 0})
    arm = simulated_arm(spec, Stream.named(1, "plant/PSM2/noise"), environment_of(wall))
    unit = np.array(normal) / np.linalg.norm(normal)
    _, outputs = played(arm, [at(FIRST_M), *[at(FIRST_M - 0.006 * unit)] * 90])
    last = outputs[-1]
    assert last.force_n is not None
    depth_m = float((FIRST_M - last.position_m) @ unit) - 0.001
    assert last.force_n == pytest.approx(stiffness_n_m * depth_m * unit, rel=5e-3, abs=1e-9)
    assert depth_m > 0.0
    assert outputs[0].force_n == (0.0, 0.0, 0.0)
