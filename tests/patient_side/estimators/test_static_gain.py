import numpy as np
import pytest

from patient_side.estimators.protocol import Estimator
from patient_side.estimators.static_gain import StaticGain, dc_gain
from patient_side.playout import Playout
from tests.patient_side.arm_models import at_operating_point, random_space, static_model


def test_freshest_command_goes_through_the_gain_about_the_operating_point() -> None:
    model = at_operating_point(static_model(gain=0.5), [1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    playout = Playout(30)
    estimator: Estimator = StaticGain(model)
    playout.command.add(4, np.array([1.2, 2.0, 2.8]))
    playout.command.add(2, np.zeros(3))
    playout.arm.add(6, np.ones(3))
    _, estimate = estimator.step(estimator.initial(), playout, 300_000_000)
    assert estimate.position_m == pytest.approx([0.2, 0.2, 0.2])
    assert estimate.covariance_m2 is None


def test_says_nothing_without_a_command() -> None:
    playout = Playout(30)
    estimator: Estimator = StaticGain(static_model())
    playout.arm.add(0, np.zeros(3))
    assert estimator.step(estimator.initial(), playout, 2_000_000)[1].position_m is None


@pytest.mark.parametrize("n", [0, 1, 4])
def test_dc_gain_is_what_a_long_simulation_settles_at(n: int) -> None:
    space = random_space(np.random.default_rng(n), n)
    for axis in range(3):
        settled = space.simulate(np.tile(np.eye(3)[axis], (400, 1)))[-1]
        assert dc_gain(space)[:, axis] == pytest.approx(settled, rel=1e-9)
