import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import HIGH, LOW, link_frames, tip_frame

# The research kit's table, row by row: alpha in degrees, a in m, offset of theta in degrees, offset of d in m.
TABLE = [
    (90, 0.0, 90, 0.0),
    (-90, 0.0, -90, 0.0),
    (90, 0.0, 0, -0.4318),
    (0, 0.0, 0, 0.4162),
    (-90, 0.0, -90, 0.0),
    (-90, 0.0091, -90, 0.0),
    (0, 0.0, 0, 0.0),
]


def random_joints(n: int) -> Array:
    return np.random.default_rng(4).uniform(LOW, HIGH, (n, 7))


def by_rotations(joints: Array, n_links: int) -> tuple[Rotation, Array]:
    """The chain as rotations and translations one after the other, without matrices of four rows."""
    turn, place = Rotation.identity(), np.zeros(3)
    for i, (alpha, a, theta, d) in enumerate(TABLE[:n_links]):
        turn = turn * Rotation.from_euler("x", alpha, degrees=True)
        place = place + turn.apply([a, 0.0, 0.0])
        slides = i == 2
        turn = turn * Rotation.from_euler("z", np.radians(theta) + (0.0 if slides else joints[i]))
        place = place + turn.apply([0.0, 0.0, d + (joints[i] if slides else 0.0)])
    return turn, place


def test_frames_are_products_of_the_published_table() -> None:
    for joints in random_joints(50):
        for n, frame in enumerate(link_frames(joints), start=1):
            turn, place = by_rotations(joints, n)
            assert frame[:3, :3] == pytest.approx(turn.as_matrix(), abs=1e-12)
            assert frame[:3, 3] == pytest.approx(place, abs=1e-12)


def test_the_arm_hangs_straight_down_from_its_remote_centre() -> None:
    tip = tip_frame(np.array([0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0]))
    # 120 - 431.8 + 416.2 mm of shaft, 9.1 mm between the wrist's axes, 10.2 mm to the control point
    assert tip[:3, 3] == pytest.approx([0.0, 0.0, -0.1237], abs=1e-12)
    assert tip[:3, 2] == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)


def test_the_shaft_passes_through_the_remote_centre_in_every_pose() -> None:
    for joints in random_joints(200):
        shaft = link_frames(joints)[3]
        from_centre = np.cross(shaft[:3, 3], shaft[:3, 2])  # 0 for a line through the origin
        assert np.linalg.norm(from_centre) < 1e-12


def test_many_poses_at_once_are_those_one_by_one() -> None:
    joints = random_joints(20)
    assert np.array_equal(tip_frame(joints), np.array([tip_frame(one) for one in joints]))


def test_mujoco_s_forward_kinematics_agree() -> None:
    mujoco = pytest.importorskip("mujoco", reason="the extra sim is not installed")
    from tis.patient_side.plant.mjcf import arm_mjcf

    model = mujoco.MjModel.from_xml_string(arm_mjcf(0.002, 1.0, np.ones(7), np.ones(7)))
    data = mujoco.MjData(model)
    for joints in random_joints(50):
        data.qpos[:] = joints
        mujoco.mj_kinematics(model, data)
        tip = tip_frame(joints)
        assert data.site_xpos[0] == pytest.approx(tip[:3, 3], abs=1e-12)
        assert data.site_xmat[0] == pytest.approx(tip[:3, :3].ravel(), abs=1e-12)
