import numpy as np
import pytest

from tis.patient_side.estimators.protocol import Estimator
from tis.patient_side.estimators.simple import Velocity
from tis.patient_side.playout import Playout

ESTIMATOR: Estimator = Velocity()


@pytest.mark.parametrize(
    ("now_ns", "travelled"),
    [
        (100_000_000, 0.0),
        (150_000_000, 1.5),
        (90_000_000, 0.0),  # a sample from the future is taken as now
        (3_600_000_000_000, 150.0),  # 5 s after the last sample it stops
    ],
)
def test_the_arm_goes_on_as_its_last_two_samples_say(now_ns: int, travelled: float) -> None:
    playout = Playout(30)
    playout.arm.add(3, np.array([2.0, 0.0, -1.0]))  # sample instant 100 ms
    playout.arm.add(1, np.array([7.0, 7.0, 7.0]))
    playout.arm.add(2, np.array([1.0, 0.0, 0.0]))
    _, estimate = ESTIMATOR.step(ESTIMATOR.initial(), playout, now_ns)
    assert estimate.position_m == pytest.approx([2.0 + travelled, 0.0, -1.0 - travelled])
    assert estimate.covariance_m2 is None


def test_over_a_gap_the_velocity_is_that_over_the_gap() -> None:
    playout = Playout(30)
    playout.arm.add(3, np.array([2.0, 0.0, 0.0]))
    assert ESTIMATOR.step(None, playout, 200_000_000)[1].position_m == pytest.approx([2.0, 0.0, 0.0])
    playout.arm.add(0, np.array([-1.0, 0.0, 0.0]))
    assert ESTIMATOR.step(None, playout, 200_000_000)[1].position_m == pytest.approx([5.0, 0.0, 0.0])


def test_nothing_without_the_arm() -> None:
    playout = Playout(30)
    playout.command.add(0, np.zeros(3))
    assert ESTIMATOR.step(None, playout, 2_000_000)[1].position_m is None
