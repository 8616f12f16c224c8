import numpy as np
import pytest

from tests.patient_side.orientation.turning import angle_deg, arrived, constant_turn
from tis.patient_side.movement_models import RateModel
from tis.patient_side.orientation.methods import ConstantRate
from tis.patient_side.playout import SourceBuffer

HORIZONS = np.array([1.0, 4.0, 30.0])


def rate_model(damping: float, span: int, axes: int, stride: int = 1) -> RateModel:
    covariance = np.array([h * np.diag(np.arange(1.0, axes + 1)) for h in HORIZONS])
    return RateModel(stride, damping, span, HORIZONS, covariance)


def method(damping: float, span: int = 1, stride: int = 1) -> ConstantRate:
    return ConstantRate(rate_model(damping, span, 3, stride), rate_model(damping, span, 1, stride))


@pytest.mark.parametrize("age", [0.0, 0.5, 3.0, 15.0, 29.5])
@pytest.mark.parametrize("span", [1, 3])
def test_an_arm_that_turns_at_a_constant_speed_about_a_known_axis_is_met(age: float, span: int) -> None:
    orientations = constant_turn(40, (1.0, -2.0, 0.5), 60.0)
    grippers_rad = 0.02 * np.arange(40)
    found = method(1.0, span).estimate(arrived(orientations, grippers_rad), age)
    truth = constant_turn(1, (1.0, -2.0, 0.5), 60.0, start_deg=60.0 * (39 + age) / 30)[0]
    assert found.orientation is not None
    assert angle_deg(found.orientation, truth) < 1e-5
    assert found.gripper_rad == pytest.approx(0.02 * (39 + age))


def test_a_lost_sample_is_replaced_by_the_nearest_at_its_true_distance() -> None:
    orientations, grippers_rad = constant_turn(40, (0.0, 1.0, 0.0), 45.0), 0.01 * np.arange(40)
    found = method(1.0).estimate(arrived(orientations, grippers_rad, lost=(38, 37)), 6.0)
    truth = constant_turn(1, (0.0, 1.0, 0.0), 45.0, start_deg=45.0 * 45 / 30)[0]
    assert found.orientation is not None
    assert angle_deg(found.orientation, truth) < 1e-5
    assert found.gripper_rad == pytest.approx(0.45)


def test_a_damped_rate_covers_the_sum_of_its_powers() -> None:
    orientations = constant_turn(10, (0.0, 0.0, 1.0), 30.0)  # a degree a sample
    found = method(0.5).estimate(arrived(orientations, np.zeros(10)), 3.0)
    assert found.orientation is not None
    assert angle_deg(found.orientation, orientations[9]) == pytest.approx(0.5 + 0.25 + 0.125)


def test_a_step_of_several_samples_scales_the_rate() -> None:
    orientations = constant_turn(20, (0.0, 0.0, 1.0), 30.0)
    found = method(0.5, stride=4).estimate(arrived(orientations, 0.1 * np.arange(20)), 8.0)
    assert found.orientation is not None
    assert angle_deg(found.orientation, orientations[19]) == pytest.approx(4 * (0.5 + 0.25))
    assert found.gripper_rad == pytest.approx(1.9 + 0.4 * 0.75)


def test_one_sample_has_no_rate_and_none_gives_no_estimate() -> None:
    orientations = constant_turn(1, (0.0, 0.0, 1.0), 30.0)
    found = method(1.0).estimate(arrived(orientations, np.array([0.3])), 5.0)
    assert found.orientation is not None
    assert found.orientation == pytest.approx(orientations[0])
    assert found.gripper_rad == 0.3
    assert method(1.0).estimate(SourceBuffer(8), 0.0).orientation is None


def test_the_covariance_lies_between_those_of_its_horizons_and_grows_beyond() -> None:
    still = arrived(constant_turn(10, (0.0, 0.0, 1.0), 0.0), np.zeros(10))
    expected = {0.5: 0.25, 1.0: 1.0, 2.5: 2.5, 30.0: 30.0, 60.0: 60.0}
    for age, size in expected.items():
        found = method(0.9).estimate(still, age)
        assert found.covariance_rad2 == pytest.approx(size * np.diag([1.0, 2.0, 3.0]))
        assert found.gripper_variance_rad2 == pytest.approx(size)
