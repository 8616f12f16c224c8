from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.arm_models import arm_model, random_noise, random_space, static_model
from tis.patient_side.estimators.protocol import Estimate, Estimator
from tis.patient_side.estimators.simple import DampedVelocity
from tis.patient_side.movement_models import InputForecast
from tis.patient_side.playout import Playout
from tis.patient_side.statespace import ArmModel


def model(damping: float) -> ArmModel:
    growth = np.array([[1e-3, 2e-3, 0.0], [3e-3, 2e-3, 0.0]])
    return replace(static_model(gain=0.5), forecast=InputForecast(damping, 1, growth))


def estimate_at(arm: ArmModel, now_ns: int) -> Estimate:
    playout = Playout(30)
    estimator: Estimator = DampedVelocity(arm)
    playout.arm.add(2, np.array([1.0, 0.0, 0.0]))
    playout.arm.add(3, np.array([2.0, 0.0, -1.0]))  # sample instant 100 ms
    return estimator.step(estimator.initial(), playout, now_ns)[1]


@pytest.mark.parametrize(
    ("damping", "now_ns", "travelled"),
    [
        (0.5, 100_000_000, 0.0),
        (0.5, 200_000_000, 0.875),  # three samples: 1/2 + 1/4 + 1/8
        (0.5, 116_666_667, 0.5 * (1 - 0.5**0.5) / 0.5),  # half a sample
        (1.0, 150_000_000, 1.5),
        (1.0, 90_000_000, 0.0),  # a sample from the future is taken as now
        (1.0, 3_600_000_000_000, 150.0),  # 5 s after the last sample it stops
    ],
)
def test_the_arm_goes_on_ever_slower(damping: float, now_ns: int, travelled: float) -> None:
    position = estimate_at(model(damping), now_ns).position_m
    assert position == pytest.approx([2.0 + travelled, 0.0, -1.0 - travelled], rel=1e-8)


def test_covariance_is_the_command_s_growth_through_the_gain() -> None:
    halfway = estimate_at(model(0.5), 150_000_000).covariance_m2  # an age of 1.5 samples
    assert halfway is not None
    assert np.sqrt(np.diag(halfway)) == pytest.approx([1e-3, 1e-3, 0.0])
    assert estimate_at(model(0.5), 300_000_000).covariance_m2 is None  # beyond the known growth


def test_no_covariance_for_a_model_with_states_and_nothing_without_the_arm() -> None:
    rng = np.random.default_rng(0)
    dynamic = arm_model(random_space(rng, 2), random_noise(rng, 2, 1e-4, 1e-5))
    assert estimate_at(dynamic, 150_000_000).covariance_m2 is None
    playout = Playout(30)
    estimator: Estimator = DampedVelocity(dynamic)
    playout.command.add(0, np.zeros(3))
    assert estimator.step(estimator.initial(), playout, 0)[1].position_m is None
