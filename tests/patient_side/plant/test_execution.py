import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.servo import servo_transition
from tis.common.sources.trajectory import HandRecording, PoseTrack, Recording
from tis.patient_side.plant.build import executed


def a_scenario(**plant: object) -> Scenario:
    source = {"kind": "synthetic"}
    return Scenario.model_validate({"version": 1, "name": "t", "source": source, "patient": {"plant": plant}})


def a_recording(n: int) -> Recording:
    t_s = np.arange(n)[:, None] / 30
    moves_m = 0.1 + 0.01 * np.sin(2 * np.pi * t_s * [0.5, 0.8, 1.1])
    turns = Rotation.from_rotvec(0.2 * np.sin(2 * np.pi * t_s * [0.4, 0.6, 0.9])).as_quat()
    arm = PoseTrack(moves_m, turns, 0.3 + 0.2 * np.sin(2 * t_s[:, 0]))
    master = PoseTrack(2 * moves_m, turns, arm.gripper_rad)
    return Recording("made up", 30, (HandRecording("left", "PSM2", master, arm),), 0, "cross")


def test_a_servo_executes_the_rows_as_its_discrete_time_system() -> None:
    source = a_recording(60)
    found = executed(source, a_scenario(kind="servo", bandwidth_hz=3, damping=0.7), 1).hands[0]
    wanted = source.hands[0].follower.position_m
    move = servo_transition(3.0, 0.7, 1 / 30)
    place, velocity = wanted[0], np.zeros(3)
    for k in range(1, 60):
        off = place - wanted[k - 1]
        place, velocity = (
            wanted[k - 1] + move[0, 0] * off + move[0, 1] * velocity,
            move[1, 0] * off + move[1, 1] * velocity,
        )
        assert found.follower.position_m[k] == pytest.approx(place, abs=1e-8)
    assert found.command is source.hands[0].command
    assert np.array_equal(found.follower.orientation, source.hands[0].follower.orientation)


def test_the_simulated_arm_follows_late_with_pose_and_gripper() -> None:
    pytest.importorskip("mujoco", reason="the extra sim is not installed")
    source = a_recording(150)
    arm = executed(source, a_scenario(kind="mujoco", bandwidth_hz=8, friction=0), 1).hands[0].follower
    wanted = source.hands[0].follower
    behind = [np.linalg.norm(arm.position_m[10 + lag :] - wanted.position_m[10 : 150 - lag]) for lag in range(5)]
    assert int(np.argmin(behind)) in (1, 2)
    turned = Rotation.from_quat(arm.orientation[12:]).inv() * Rotation.from_quat(wanted.orientation[10:-2])
    assert np.degrees(turned.magnitude()).max() < 3.0
    assert np.abs(arm.gripper_rad[12:] - wanted.gripper_rad[10:-2]).max() < 0.05


def test_a_replay_executes_nothing() -> None:
    with pytest.raises(InputError, match=r"patient\.plant: kind: must be servo or mujoco"):
        executed(a_recording(3), a_scenario(kind="replay"), 1)
