import numpy as np

from tests.patient_side.orientation.turning import arrived, constant_turn
from tis.patient_side.orientation.methods import Hold
from tis.patient_side.playout import SourceBuffer


def test_it_repeats_the_freshest_sample_whatever_its_age() -> None:
    orientations = constant_turn(10, (0.0, 0.0, 1.0), 30.0)
    buffer = arrived(orientations, np.arange(10.0))
    for age in (0.0, 0.4, 100.0):
        found = Hold().estimate(buffer, age)
        assert found.orientation is not None
        assert found.orientation.tolist() == orientations[9].tolist()
        assert found.gripper_rad == 9.0
        assert found.covariance_rad2 is None
        assert found.gripper_variance_rad2 is None


def test_a_late_sample_does_not_replace_a_fresher_one() -> None:
    buffer = arrived(constant_turn(10, (0.0, 0.0, 1.0), 30.0), np.arange(10.0), lost=(4,))
    before = Hold().estimate(buffer, 1.0)
    buffer.add(4, np.zeros(3), 4.0, np.array([0.0, 0.0, 0.0, 1.0]))
    after = Hold().estimate(buffer, 1.0)
    assert np.array_equal(after.orientation, before.orientation)  # type: ignore[arg-type]
    assert after.gripper_rad == 9.0


def test_nothing_before_the_first_sample() -> None:
    found = Hold().estimate(SourceBuffer(8), 0.0)
    assert found.orientation is None
    assert found.gripper_rad is None
