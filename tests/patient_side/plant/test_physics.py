from collections.abc import Callable

import numpy as np
import pytest

from tis.common.errors import InputError
from tis.common.extras import GET_SIM
from tis.common.scenario.patient import MujocoPlant
from tis.common.servo import servo_transition
from tis.patient_side.linear_system import Array
from tis.patient_side.plant import physics
from tis.patient_side.plant.arm_geometry import COM_M, HIGH, INERTIA_KG_M2, LOW, MASS_KG, MOTOR_INERTIA, link_frames
from tis.patient_side.plant.mjcf import arm_mjcf
from tis.patient_side.plant.physics import ArmPhysics, check_simulator, mass_matrix

HOME = np.array([0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0])
BENT = np.array([0.4, -0.3, 0.16, 1.2, 0.5, -0.6, 0.3])


def spec(**fields: object) -> MujocoPlant:
    return MujocoPlant.model_validate({"kind": "mujoco", **fields})


@pytest.fixture(scope="module")
def mujoco() -> object:
    return pytest.importorskip("mujoco", reason="the extra sim is not installed")


def inertia_by_differences(joints: Array) -> Array:
    """The mass matrix from the velocities of the links' centres of mass, by central differences of the frames."""
    step = 1e-6

    def slope(of: Callable[[Array], Array]) -> list[Array]:
        return [(of(joints + step * e) - of(joints - step * e)) / (2 * step) for e in np.eye(7)]

    found = np.diag(MOTOR_INERTIA)
    for i in range(7):

        def frame(q: Array, link: int = i) -> Array:
            return link_frames(q)[link]

        turn = frame(joints)[:3, :3]
        moves = slope(frame)
        linear = np.array([m[:3, 3] + m[:3, :3] @ COM_M[i] for m in moves])
        spins = [turn.T @ m[:3, :3] for m in moves]
        angular = np.array([[w[2, 1], w[0, 2], w[1, 0]] for w in spins])
        found += MASS_KG[i] * linear @ linear.T + angular @ np.diag(INERTIA_KG_M2[i]) @ angular.T
    return found


def test_mujoco_s_mass_matrix_is_that_of_the_table_of_links(mujoco: object) -> None:
    arm = ArmPhysics(spec())
    import mujoco as mj

    data = mj.MjData(arm.model)
    for joints in (HOME, BENT):
        data.qpos[:] = joints
        mj.mj_forward(arm.model, data)
        found = mass_matrix(mj, arm.model, data)
        assert found == pytest.approx(inertia_by_differences(joints), rel=1e-5, abs=1e-9)


def test_kinetic_energy_stays_without_motors_and_friction(mujoco: object) -> None:
    import mujoco as mj

    model = mj.MjModel.from_xml_string(arm_mjcf(1e-5, 0.0, np.zeros(7), np.zeros(7)))
    data = mj.MjData(model)
    data.qpos[:], data.qvel[:] = BENT, [0.5, -0.4, 0.05, 2.0, 1.5, -1.0, 1.0]
    mj.mj_forward(model, data)
    before = data.qvel @ mass_matrix(mj, model, data) @ data.qvel
    mj.mj_step(model, data, 20_000)
    mj.mj_forward(model, data)
    after = data.qvel @ mass_matrix(mj, model, data) @ data.qvel
    assert np.linalg.norm(data.qpos - BENT) > 0.2
    assert after == pytest.approx(before, rel=1e-3)


def test_the_arm_at_rest_carries_its_weight(mujoco: object) -> None:
    arm = ArmPhysics(spec(friction=0))
    moved = arm.advance(arm.at_rest(BENT), BENT, 2000)
    assert moved.joints == pytest.approx(BENT, abs=1e-9)


@pytest.mark.parametrize("joint", [0, 2, 5])
def test_a_joint_follows_the_loop_s_differential_equation(mujoco: object, joint: int) -> None:
    arm = ArmPhysics(spec(friction=0, bandwidth_hz=5, damping=0.7, physics_hz=5000))
    target = HOME.copy()
    target[joint] += 1e-4
    moved = arm.advance(arm.at_rest(HOME), target, 200)  # 40 ms
    expected = 1.0 - servo_transition(5.0, 0.7, 0.04)[0, 0]
    assert (moved.joints[joint] - HOME[joint]) / 1e-4 == pytest.approx(expected, rel=0.05)


def test_a_state_determines_what_follows_bit_for_bit(mujoco: object) -> None:
    arm, other = ArmPhysics(spec()), ArmPhysics(spec())
    start = arm.at_rest(HOME)
    straight = arm.advance(start, BENT, 60)
    half = arm.advance(start, BENT, 25)
    arm.advance(arm.at_rest(BENT), HOME, 400)  # whatever happens in between
    rest = other.advance(half.state, BENT, 35)
    assert rest.state.tobytes() == straight.state.tobytes()
    assert rest.joints.tobytes() == straight.joints.tobytes()


@pytest.mark.parametrize(
    "fields", [{}, {"bandwidth_hz": 26.5}, {"bandwidth_hz": 20, "damping": 0.2}, {"friction": 0}]
)
def test_the_joints_stay_within_their_stops_whatever_the_set_points(
    mujoco: object, fields: dict[str, object]
) -> None:
    arm, rng = ArmPhysics(spec(**fields)), np.random.default_rng(3)
    state = arm.at_rest(HOME)
    for _ in range(60):
        moved = arm.advance(state, rng.choice([LOW, HIGH]) if rng.random() < 0.5 else rng.uniform(LOW, HIGH), 33)
        state = moved.state
        beyond = np.maximum(moved.joints - HIGH, LOW - moved.joints)
        assert (beyond < [0.2, 0.2, 0.02, 0.2, 0.2, 0.2, 0.2]).all()


def test_a_missing_simulator_is_named_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(physics, "find_spec", lambda _: None)
    with pytest.raises(InputError) as caught:
        check_simulator()
    assert str(caught.value) == (f"patient.plant: kind: mujoco needs the package mujoco: {GET_SIM}")


def test_a_loop_that_the_physics_cannot_hold_is_refused() -> None:
    with pytest.raises(ValueError, match=r"bandwidth_hz must be at most 26\.5 at this physics_hz"):
        spec(bandwidth_hz=30)
    assert spec(bandwidth_hz=30, physics_hz=1000).bandwidth_hz == 30
