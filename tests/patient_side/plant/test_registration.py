import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from tis.patient_side.linear_system import Array
from tis.patient_side.plant.arm_geometry import tip_frame
from tis.patient_side.plant.protocol import Reference
from tis.patient_side.plant.simulated_arm import Registration, inverse, orientation_of, pose

HOME = tip_frame(np.array([0.0, 0.0, 0.12, 0.0, 0.0, 0.0, 0.0]))
PLACES = arrays(float, 3, elements=st.floats(-1.0, 1.0))
TURNS = arrays(float, 3, elements=st.floats(-1.7, 1.7))


def reference(place_m: Array, vector: Array) -> Reference:
    return Reference(place_m, Rotation.from_rotvec(vector).as_quat(), 0.0)


@given(PLACES, TURNS, PLACES, TURNS)
def test_a_registration_keeps_distances_and_angles(
    first_m: Array, first_turn: Array, other_m: Array, other_turn: Array
) -> None:
    first, other = reference(first_m, first_turn), reference(other_m, other_turn)
    found = Registration.at_home(first, HOME)
    there = found.to_base @ pose(other)
    assert found.to_base @ pose(first) == pytest.approx(HOME, abs=1e-12)
    assert np.linalg.norm(there[:3, 3] - HOME[:3, 3]) == pytest.approx(np.linalg.norm(other_m - first_m), abs=1e-12)
    back = found.from_base @ there
    assert back[:3, 3] == pytest.approx(other_m, abs=1e-12)
    turned = Rotation.from_quat(orientation_of(back)).inv() * Rotation.from_rotvec(other_turn)
    assert turned.magnitude() < 1e-7


@given(PLACES, TURNS)
def test_the_inverse_is_numpy_s(place_m: Array, vector: Array) -> None:
    motion = pose(reference(place_m, vector))
    assert inverse(motion) == pytest.approx(np.linalg.inv(motion), abs=1e-12)
