import numpy as np
import pytest
from scipy.stats import kstest

from tis.common.scenario.patient import MujocoPlant
from tis.common.streams import Stream
from tis.patient_side.dynamics.parameters import base_parameters, regressor, true_parameters
from tis.patient_side.dynamics.readings import clean_equations, equations, read
from tis.patient_side.linear_system import Array
from tis.patient_side.plant.physics import ArmPhysics, Motion

HOME = np.array([0.1, 0.2, 0.12, 0.3, 0.1, -0.2, 0.2])


def sines(n: int, rate_hz: int) -> tuple[Array, Array, Array]:
    t_s = np.arange(n)[:, None] / rate_hz
    w, size = 2 * np.pi * np.linspace(0.3, 1.2, 7), np.array([0.3, 0.3, 0.03, 0.5, 0.4, 0.4, 0.3])
    return (
        HOME + size * np.sin(w * t_s),
        size * w * np.cos(w * t_s),
        -size * w**2 * np.sin(w * t_s),
    )


def test_the_equations_of_sines_hold_for_the_parameters_of_their_torques() -> None:
    q, v, a = sines(5000, 500)
    values, base = true_parameters(1.0), base_parameters()
    motion = Motion(q, regressor(q, v, a) @ values)
    found = equations(motion, 500, base.independent)
    residual = found.torque - found.matrix @ (base.combine @ values)
    for joint in range(7):
        of = found.joint == joint
        # an eighth of a second in 8 s, 20 rows a second, without the slow ones
        assert 80 < of.sum() <= 161
        assert np.std(residual[of]) < 0.005 * np.std(found.torque[of])


def test_readings_have_the_noise_of_their_joints() -> None:
    motion = Motion(np.tile(HOME, (600, 1)), np.zeros((600, 7)))
    std = np.array([1e-3, 0.0, 1e-5, 0.0, 0.0, 0.0, 2e-3])
    stream = Stream.named(1, "noise")
    error = read(motion, std, stream).joints - motion.joints
    assert np.abs(error[:, [1, 3, 4, 5]]).max() < 1e-15
    for joint in (0, 2, 6):
        assert kstest(error[:, joint] / std[joint], "norm").pvalue > 0.01
    assert error[10, 0] == pytest.approx(read(motion, std, stream).joints[10, 0] - HOME[0], abs=1e-15)
    assert read(motion, np.zeros(7), stream) is motion


def test_a_clean_simulated_movement_holds_for_the_true_parameters_to_the_last_digits() -> None:
    pytest.importorskip("mujoco", reason="the extra sim is not installed")
    spec, base = MujocoPlant(kind="mujoco", encoder_noise_mrad=0.0, encoder_noise_mm=0.0), base_parameters()
    set_points = sines(2000, spec.physics_hz)[0]
    arm = ArmPhysics(spec)
    found = clean_equations(arm.follow(arm.at_rest(set_points[0]), set_points), spec.physics_hz, base.independent)
    residual = found.torque - found.matrix @ (base.combine @ true_parameters(spec.friction))
    for joint in range(7):
        of = found.joint == joint
        assert 15 < of.sum() <= 40
        assert np.std(residual[of]) < 1e-6 * np.std(found.torque[of])
