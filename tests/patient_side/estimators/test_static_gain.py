from dataclasses import replace

import numpy as np
import pytest

from tests.patient_side.arm_models import at_operating_point, random_space, static_model
from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.estimators.simple import StaticGain, dc_gain
from tis.patient_side.playout import Playout


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


def test_where_a_gain_is_all_the_offset_is_that_of_the_freshest_pair() -> None:
    model = at_operating_point(static_model(gain=0.5), [1.0, 2.0, 3.0], [0.1, 0.2, 0.3])
    playout, estimator = Playout(30), StaticGain(model)
    for i, x in ((0, 0.0), (3, 0.2), (7, 0.6)):
        playout.command.add(i, np.full(3, x))
    for i, x in ((0, 9.0), (3, 5.0), (4, 7.0), (5, 8.0)):  # the command of 4 and 5 is lost
        playout.arm.add(i, np.full(3, x))
    _, estimate = estimator.step(None, playout, 300_000_000)
    assert estimate.position_m == pytest.approx(np.full(3, 5.0 + 0.5 * (0.6 - 0.2)))
    lagging = replace(model, static=False)
    _, estimate = StaticGain(lagging).step(None, playout, 300_000_000)
    assert estimate.position_m == pytest.approx([0.1 - 0.2, 0.2 - 0.7, 0.3 - 1.2])


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
