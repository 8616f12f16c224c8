import numpy as np

from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.playout import Playout


def test_hold_returns_the_freshest_arm_sample_by_source_stamp() -> None:
    playout = Playout(30)
    hold: Estimator = Hold()
    playout.arm.add(5, np.array([5.0, 0.0, 0.0]))
    playout.arm.add(3, np.array([3.0, 0.0, 0.0]))
    playout.command.add(9, np.array([9.0, 0.0, 0.0]))
    _, estimate = hold.step(hold.initial(), playout, 400_000_000)
    assert estimate.position_m is not None
    assert estimate.position_m.tolist() == [5.0, 0.0, 0.0]
    assert estimate.covariance_m2 is None


def test_hold_says_nothing_without_the_arm() -> None:
    playout = Playout(30)
    hold: Estimator = Hold()
    playout.command.add(0, np.zeros(3))
    _, estimate = hold.step(hold.initial(), playout, 2_000_000)
    assert estimate.position_m is None
