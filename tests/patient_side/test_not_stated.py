"""What no message can state is counted, and ends nothing."""

from typing import Any

import numpy as np
import pytest

from tests.nodes import LEFT, Stamp, a_pose, an_arrival
from tis.common.node import Emission
from tis.common.ticker import Ticker
from tis.patient_side.estimators.simple import Hold
from tis.patient_side.hand import PatientHand
from tis.patient_side.node import PatientNode
from tis.patient_side.orientation.wrist import WristEstimate, stated, stated_turn
from tis.patient_side.plant.protocol import PlantOutput
from tis.patient_side.playout import Playout

_TURN = np.array([0.0, 0.0, 0.0, 1.0])


@pytest.mark.parametrize(
    "turn", [[0.0, 0.0, 0.0, 0.0], [np.nan, 0.0, 0.0, 1.0], [np.inf, 0.0, 0.0, 1.0], [0.0, 0.0, 1e200, 0.0]]
)
def test_numbers_that_are_no_orientation_are_not_stated(turn: list[float]) -> None:
    assert stated_turn(np.array(turn)) is None
    found, is_whole = stated(WristEstimate(np.array(turn), np.eye(3), 0.5, 0.25))
    assert not is_whole
    assert (found.orientation, found.std_rad, found.gripper_rad, found.gripper_std_rad) == (None, None, 0.5, 0.5)


@pytest.mark.parametrize(
    ("variances", "gripper_rad", "variance"),
    [((-1.0, 1.0, 1.0), 0.5, 0.25), ((1.0, np.nan, 1.0), 0.5, 0.25), ((1.0, 1.0, 1.0), 1e10, 0.25),
     ((1.0, 1.0, 1.0), np.nan, 0.25), ((1.0, 1.0, 1.0), 0.5, -1.0), ((1.0, 1.0, 1.0), 0.5, np.inf)],
)  # fmt: skip
def test_an_estimate_is_stated_as_far_as_it_can_be(
    variances: tuple[float, float, float], gripper_rad: float, variance: float
) -> None:
    found, is_whole = stated(WristEstimate(_TURN, np.diag(variances), gripper_rad, variance))
    assert not is_whole
    assert found.orientation is not None


def test_a_variance_that_rounding_leaves_below_zero_is_zero() -> None:
    found, is_whole = stated(WristEstimate(_TURN, np.diag([-1e-20, 1.0, 1.0]), 0.5, -1e-20))
    assert is_whole
    assert found.std_rad is not None
    assert (found.std_rad.x, found.gripper_std_rad) == (0.0, 0.0)


class _Broken:
    """An arm that is where no message can say."""

    def __init__(self, where: float) -> None:
        self._at = np.array([where, 0.0, 0.0])

    def initial(self) -> None:
        return None

    def step(self, *_: Any) -> tuple[None, PlantOutput]:
        return None, PlantOutput(self._at, self._at)


@pytest.mark.parametrize(("where", "is_stated"), [(0.1, True), (np.nan, False), (np.inf, False), (1e10, False)])
def test_an_arm_that_has_left_the_numbers_measures_nothing(where: float, is_stated: bool) -> None:
    hand = PatientHand(LEFT, Playout(30), [Hold()], _Broken(where))
    node = PatientNode("tis", [hand], Ticker(30, 10, 2_000_000), lambda: 0)
    node.receive(an_arrival("tis/PSM2/setpoint_cp", 0, Stamp(0, 0, 0), a_pose(0.1)))
    sent = [one.key for one in node.wake(2_000_000) if isinstance(one, Emission)]
    assert ("tis/PSM2/measured_cp" in sent) is is_stated
    assert node.counters()["not_stated"] == (not is_stated)
