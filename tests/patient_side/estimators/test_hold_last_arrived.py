import numpy as np

from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.estimators.simple import HoldLastArrived
from tis.patient_side.playout import Playout


def test_it_returns_what_arrived_last_however_old() -> None:
    playout = Playout(30)
    estimator: Estimator = HoldLastArrived()
    assert estimator.step(estimator.initial(), playout, 2_000_000)[1].position_m is None
    for index in (5, 3):
        playout.arm.add(index, np.array([float(index), 0.0, 0.0]))
    playout.command.add(9, np.array([9.0, 0.0, 0.0]))
    _, estimate = estimator.step(estimator.initial(), playout, 400_000_000)
    assert estimate.position_m is not None
    assert estimate.position_m.tolist() == [3.0, 0.0, 0.0]
    assert estimate.covariance_m2 is None
