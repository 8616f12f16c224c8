"""Operations on quaternions against SciPy's Rotation, and against hand-computed cases."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tis.patient_side.rotations import at_end, turned, turned_by, unit

HALF = np.sqrt(0.5)
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
PART = st.floats(-1.0, 1.0)
QUATERNION = st.tuples(PART, PART, PART, PART).filter(lambda q: sum(x * x for x in q) > 1e-2)
VECTOR = st.tuples(*[st.floats(-3.0, 3.0)] * 3)


@given(QUATERNION, QUATERNION)
def test_turned_is_the_shorter_rotation_of_scipy(one: tuple[float, ...], other: tuple[float, ...]) -> None:
    a, b = Rotation.from_quat(one), Rotation.from_quat(other)
    found = turned(a.as_quat(), b.as_quat())
    assert np.linalg.norm(found) <= np.pi + 1e-12
    assert (a * Rotation.from_rotvec(found)).approx_equal(b, atol=1e-7)
    # the sign of a quaternion does not matter
    assert Rotation.from_rotvec(turned(-a.as_quat(), b.as_quat())).approx_equal(Rotation.from_rotvec(found), 1e-7)


@given(QUATERNION, VECTOR)
def test_turned_by_is_scipys_product_and_stays_a_unit(one: tuple[float, ...], vector: tuple[float, ...]) -> None:
    start = Rotation.from_quat(one)
    found = turned_by(start.as_quat(), np.array(vector))
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-15)
    assert Rotation.from_quat(found).approx_equal(start * Rotation.from_rotvec(vector), atol=1e-7)


def test_a_quarter_turn_about_z_by_hand() -> None:
    quarter = np.array([0.0, 0.0, HALF, HALF])
    assert turned(LEVEL, quarter) == pytest.approx([0.0, 0.0, np.pi / 2])
    assert turned(quarter, LEVEL) == pytest.approx([0.0, 0.0, -np.pi / 2])
    # then a quarter about the body's x, which points along the world's y: y goes to z, and z to x
    both = turned_by(turned_by(LEVEL, np.array([0.0, 0.0, np.pi / 2])), np.array([np.pi / 2, 0.0, 0.0]))
    assert Rotation.from_quat(both).apply([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) == pytest.approx(
        np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    )


def test_small_turns_keep_their_digits() -> None:
    for size in (0.0, 1e-12, 1e-9, 1e-7, 1e-5):
        vector = np.array([size, -2.0 * size, 0.5 * size])
        assert turned(LEVEL, turned_by(LEVEL, vector)) == pytest.approx(vector, rel=1e-9, abs=1e-30)


def test_many_orientations_at_once_are_each_alone() -> None:
    start, others = Rotation.random(5, random_state=1).as_quat(), Rotation.random(35, random_state=2).as_quat()
    found = turned(start[:, None], others.reshape(5, 7, 4))
    assert found.shape == (5, 7, 3)
    for i in range(5):
        for j in range(7):
            assert found[i, j] == pytest.approx(turned(start[i], others[7 * i + j]), abs=1e-14)


def test_a_quaternion_of_any_length_becomes_a_unit_and_one_of_no_length_none() -> None:
    found = unit((0.0, 0.0, 3.0, 4.0))
    assert found == (0.0, 0.0, 0.6, 0.8)
    assert unit((0.0, 0.0, 0.0, 0.0)) is None
    assert unit((1e-9, 0.0, 0.0, 0.0)) is None


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (1e-5, 0.0, -1e-5), (0.3, -0.2, 0.9), (2.0, 1.0, -1.0)])
def test_a_covariance_moves_to_the_end_as_differences_of_rotations_do(vector: tuple[float, float, float]) -> None:
    v, step = np.array(vector), 1e-6
    jacobian = np.empty((3, 3))
    for axis in range(3):
        ahead, back = v.copy(), v.copy()
        ahead[axis] += step
        back[axis] -= step
        end = Rotation.from_rotvec(v).inv()
        both = [(end * Rotation.from_rotvec(each)).as_rotvec() for each in (ahead, back)]
        jacobian[:, axis] = (both[0] - both[1]) / (2 * step)
    covariance = np.array([[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]])
    assert at_end(v, covariance) == pytest.approx(jacobian @ covariance @ jacobian.T, abs=1e-7)
