"""No leak: whatever comes later, the estimates up to now stay equal bit for bit."""

import numpy as np
import pytest

from tests.patient_side.orientation.test_tangent_ls import method, movement
from tests.patient_side.orientation.turning import random_angles, random_turns
from tis.common.scenario.patient import OrientationMethod
from tis.common.sources.trajectory import Array
from tis.patient_side.movement_models import WristModel
from tis.patient_side.orientation.methods import METHODS
from tis.patient_side.orientation.wrist import WristEstimate, WristMethod
from tis.patient_side.playout import SourceBuffer

NOW = 300


def model() -> WristModel:
    return WristModel(method().orientation, method().gripper)


def estimates(built: WristMethod, orientations: Array, grippers_rad: Array, delay: int) -> list[WristEstimate]:
    """The estimates at each row, of samples that arrive ``delay`` rows late, every seventh never and some late."""
    buffer, found = SourceBuffer(4096), []
    for k in range(len(orientations)):
        for i in (k - delay, k - delay - 5):
            if i >= 0 and i % 7 and (i % 3 == 0) == (i == k - delay - 5):
                buffer.add(i, np.zeros(3), float(grippers_rad[i]), orientations[i])
        found.append(built.estimate(buffer, float(max(k - buffer.newest, 0)) + 0.06))
    return found


def bits(one: WristEstimate) -> tuple[bytes | None, ...]:
    return tuple(None if part is None else np.asarray(part).tobytes() for part in one)


@pytest.mark.parametrize("name", list(METHODS))
@pytest.mark.parametrize("delay", [0, 3, 15])
def test_perturbing_every_future_sample_changes_no_estimate_up_to_now(name: OrientationMethod, delay: int) -> None:
    built = METHODS[name](model())
    assert built is not None
    rng = np.random.default_rng(4)
    orientations, grippers_rad = random_turns(rng, 400), random_angles(rng, 400)
    other, other_rad = random_turns(rng, 400), random_angles(rng, 400)
    other[: NOW + 1], other_rad[: NOW + 1] = orientations[: NOW + 1], grippers_rad[: NOW + 1]
    one = [bits(each) for each in estimates(built, orientations, grippers_rad, delay)]
    two = [bits(each) for each in estimates(built, other, other_rad, delay)]
    assert one[: NOW + 1] == two[: NOW + 1]
    assert one[NOW + 1 + delay + 5 :] != two[NOW + 1 + delay + 5 :]  # the perturbation is seen once it has arrived


@pytest.mark.parametrize("name", list(METHODS))
def test_an_estimate_changes_nothing_and_is_the_same_again(name: OrientationMethod) -> None:
    built = METHODS[name](model())
    assert built is not None
    orientations, grippers_rad = movement(2)
    buffer = SourceBuffer(4096)
    for k in range(200):
        buffer.add(k, np.zeros(3), float(grippers_rad[k]), orientations[k])
    first = bits(built.estimate(buffer, 4.5))
    built.estimate(buffer, 9.0)
    assert bits(built.estimate(buffer, 4.5)) == first
