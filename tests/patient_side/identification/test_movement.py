"""Movement of training rows: a circle has a constant speed and acceleration, and a jump is no movement."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from tis.patient_side.identification.dataset import movement_of, trained
from tis.patient_side.statespace import Movement


def test_a_circle_has_its_radius_speed_and_acceleration_whatever_jumps() -> None:
    rate_hz, radius_m, turns_rad_s = 1000, 2.5, 2.0
    centre_m = np.array([7.0, 0.0, 1.0])
    angle = turns_rad_s * np.arange(200_000) / rate_hz
    circle_m = np.stack([radius_m * np.cos(angle), radius_m * np.sin(angle), 0.0 * angle], axis=1) + centre_m
    circle_m[5000] += 90.0
    found = movement_of([circle_m, circle_m[:1]], centre_m, rate_hz)
    assert found.reach_m == pytest.approx(radius_m, rel=1e-3)
    assert found.speed_m_s == pytest.approx(radius_m * turns_rad_s, rel=1e-2)
    assert found.acceleration_m_s2 == pytest.approx(radius_m * turns_rad_s**2, rel=1e-2)


@pytest.mark.parametrize(
    ("source", "plant", "follows"),
    [("table", "replay", True), ("table", "external", False), ("jigsaws", "replay", False)],
)
def test_limits_follow_a_table_but_never_for_an_arm_outside(source: str, plant: str, follows: bool) -> None:
    scenario: Any = SimpleNamespace(
        source=SimpleNamespace(kind=source), patient=SimpleNamespace(plant=SimpleNamespace(kind=plant))
    )
    assert (trained(scenario, Movement(7.0, 3.0, 1.0)) is not None) == follows
