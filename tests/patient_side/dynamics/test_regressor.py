import numpy as np
import pytest

from tis.patient_side.dynamics.parameters import regressor, true_parameters
from tis.patient_side.plant.arm_geometry import COM_M, HIGH, LOW, MASS_KG, link_frames
from tis.patient_side.plant.mjcf import arm_mjcf


def test_torques_are_those_of_mujoco_s_inverse_dynamics() -> None:
    mujoco = pytest.importorskip("mujoco", reason="the extra sim is not installed")
    model = mujoco.MjModel.from_xml_string(arm_mjcf(0.002, 1.5, np.zeros(7), np.zeros(7)))
    data, rng, values = mujoco.MjData(model), np.random.default_rng(8), true_parameters(1.5)
    for _ in range(30):
        q, a = rng.uniform(LOW, HIGH), rng.normal(0.0, 5.0, 7)
        v = rng.choice([-1.0, 1.0], 7) * rng.uniform(0.5, 2.0, 7)  # fast enough for Coulomb's friction
        data.qpos[:], data.qvel[:], data.qacc[:] = q, v, a
        mujoco.mj_inverse(model, data)
        torque = regressor(q[None], v[None], a[None])[0] @ values
        assert torque == pytest.approx(data.qfrc_inverse, abs=1e-10)


def test_torques_at_rest_are_the_slope_of_the_potential_energy() -> None:
    values, step = true_parameters(0.0), 1e-6

    def energy(joints: np.ndarray) -> float:
        places = [frame @ [*com, 1.0] for frame, com in zip(link_frames(joints), COM_M, strict=True)]
        return float(sum(m * 9.81 * place[2] for m, place in zip(MASS_KG, places, strict=True)))

    rest = np.zeros((1, 7))
    for joints in np.random.default_rng(3).uniform(LOW, HIGH, (10, 7)):
        slope = [(energy(joints + step * e) - energy(joints - step * e)) / (2 * step) for e in np.eye(7)]
        assert regressor(joints[None], rest, rest)[0] @ values == pytest.approx(slope, abs=1e-8)


def test_the_given_direction_replaces_the_sign_of_the_velocity() -> None:
    q, v, a = (np.random.default_rng(n).normal(size=(1, 7)) for n in range(3))
    share = np.full((1, 7), 0.25)
    coulomb = np.arange(12, 91, 13)
    assert np.array_equal(regressor(q, v, a)[0][:, coulomb], np.diag(np.sign(v[0])))
    assert np.array_equal(regressor(q, v, a, share)[0][:, coulomb], 0.25 * np.eye(7))
