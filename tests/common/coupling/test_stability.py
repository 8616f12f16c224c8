"""The limit of a delayed loop: published cases, the loop in time, and eigenvalues of the sampled loop."""

from math import inf, pi

import numpy as np
import pytest

from tests.common.coupling.loop import PERIOD_S
from tis.common.coupling.stability import Arm, Limb, critical_stiffness, loop_limit
from tis.common.servo import servo_transition
from tis.surgeon_side.operator import Operator

HOGAN, YOKOKOHJI = Limb(0.9, 6.0, 568.0), Limb(2.1, 2.5, 10.0)


@pytest.mark.parametrize(
    ("limb", "limits"),
    [(HOGAN, [584.6, 161.4, 175.4, 387.7]), (YOKOKOHJI, [238.6, 50.1, 25.6, 13.3])],
)
def test_the_limit_is_that_of_the_published_cases_and_not_monotone(limb: Limb, limits: list[float]) -> None:
    """Round trips of 10, 50, 100 and 200 ms, and half a tick of 1 ms."""
    assert [critical_stiffness(limb, s) for s in (0.0105, 0.0505, 0.1005, 0.2005)] == pytest.approx(limits, abs=0.06)


def _growth(limb: Limb, stiffness_n_m: float, ticks: int, n: int = 30_000) -> float:
    """Return late over early amplitude of a hand that feels a wall at its own place, some ticks ago."""
    hand = Operator(limb, PERIOD_S, off_m=(1e-3, 0.0, 0.0))
    places = [0.0] * ticks
    for _ in range(n):
        places.append(hand.off_m[0])
        hand.move((-stiffness_n_m * places[-1 - ticks], 0.0, 0.0))
    late, early = np.abs(places[-n // 4 :]).max(), np.abs(places[n // 2 : 3 * n // 4]).max()
    return float(late / early)


@pytest.mark.parametrize("limb", [HOGAN, YOKOKOHJI])
@pytest.mark.parametrize("ticks", [10, 50, 100, 200])
def test_a_loop_in_time_grows_above_the_limit_and_decays_below(limb: Limb, ticks: int) -> None:
    """The force is held for a tick, which counts as half a tick of delay; within 1 %."""
    limit = critical_stiffness(limb, (ticks + 0.5) * PERIOD_S)
    assert _growth(limb, 0.99 * limit, ticks) < 1.0 < _growth(limb, 1.01 * limit, ticks)


def test_a_longer_delay_can_make_the_loop_stable_again() -> None:
    between = 250.0
    assert critical_stiffness(HOGAN, 0.0505) < between < critical_stiffness(HOGAN, 0.2005)
    assert _growth(HOGAN, between, 200) < 1.0 < _growth(HOGAN, between, 50)


@pytest.mark.parametrize("ticks", [5, 20, 80])
def test_the_sampled_limit_without_an_arm_is_that_in_continuous_time_at_short_ticks(ticks: int) -> None:
    for limb in (HOGAN, YOKOKOHJI):
        assert loop_limit(limb, None, ticks * PERIOD_S, PERIOD_S) == pytest.approx(
            critical_stiffness(limb, (ticks + 0.5) * PERIOD_S), rel=2e-3
        )


def _radius(limb: Limb, arm: Arm, stiffness_n_m: float, ticks: int) -> float:
    """Return the largest eigenvalue of hand, delay line and arm in contact, tick by tick."""
    natural = (limb.stiffness_n_m / limb.mass_kg) ** 0.5
    hand = servo_transition(natural / (2 * pi), limb.damping_ns_m / (2 * limb.mass_kg * natural), PERIOD_S)
    w = 2 * pi * arm.bandwidth_hz
    touching = (w**2 + stiffness_n_m / arm.mass_kg) ** 0.5
    move = servo_transition(touching / (2 * pi), arm.damping * w / touching, PERIOD_S)
    n = 4 + ticks
    a = np.zeros((n, n))  # hand 2, arm 2, the hand's places of the last ticks
    a[:2, :2], a[:2, 2] = hand, -(np.eye(2) - hand)[:, 0] * stiffness_n_m / limb.stiffness_n_m
    a[2:4, 2:4], a[2:4, n - 1 if ticks else 0] = move, (np.eye(2) - move)[:, 0] * (w / touching) ** 2
    if ticks:
        a[4, 0] = 1.0
        for i in range(5, n):
            a[i, i - 1] = 1.0
    return float(np.abs(np.linalg.eigvals(a)).max())


@pytest.mark.parametrize("arm", [Arm(10.0, 1.0, 0.3), Arm(4.0, 0.4, 0.5), Arm(1000.0, 1.0, 1.0)])
@pytest.mark.parametrize("ticks", [6, 40])
def test_the_limit_with_an_arm_is_where_an_eigenvalue_leaves_the_unit_circle(arm: Arm, ticks: int) -> None:
    for limb in (HOGAN, YOKOKOHJI):
        limit = loop_limit(limb, arm, ticks * PERIOD_S, PERIOD_S)
        assert limit < inf
        assert _radius(limb, arm, 0.999 * limit, ticks) < 1.0 < _radius(limb, arm, 1.001 * limit, ticks)
