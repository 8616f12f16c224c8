"""Waves and passivity control: displayed stiffness in closed form, and no energy for the hand but its own."""

from math import cos, pi

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.common.coupling.loop import PERIOD_S, Line, Loop, a_servo, energy_j
from tis.common.coupling.stability import Limb
from tis.common.coupling.tdpa import PassiveArm, ReceivedEnergy
from tis.common.coupling.wave import WaveArm, WaveQueue, is_too_strong
from tis.common.vector import Vector, dot, plus, scaled

HOGAN = Limb(0.9, 6.0, 568.0)
PART = st.floats(-5, 5)
TRIPLE = st.tuples(PART, PART, PART)


@pytest.mark.parametrize("ticks", [10, 50, 100])
@pytest.mark.parametrize("stiffness_n_m", [200.0, 400.0, 1500.0])
def test_waves_display_the_stiffness_of_the_closed_form(stiffness_n_m: float, ticks: int) -> None:
    """Wall, servo and line in series; the movement of a tick lies half a tick back. Within 0.5 %."""
    loop = Loop("wave", a_servo(stiffness_n_m), HOGAN, Line(ticks), Line(ticks))
    places, forces = loop.run(9000, lambda k: -0.01 * (1 - cos(pi * min(k / 4000, 1.0))))
    shown = forces[-2000:].mean() / places[-2000:].mean()
    line = (ticks + 0.5) * PERIOD_S / loop.impedance_ns_m
    assert shown == pytest.approx(1 / (1 / stiffness_n_m + 1 / loop.servo.stiffness_n_m + line), rel=5e-3)


def _tapping(k: int) -> float:
    """The hand's intention: into the wall and out of it, 0.8 times a second."""
    return 0.004 - 0.006 * (1 - cos(2 * pi * 0.8 * k * PERIOD_S))


def _least_j(kind: str, stiffness_n_m: float, ticks: int, is_bad: bool, n: int = 3000) -> float:
    lines = [Line(ticks, 0.1, 4, 0.05, np.random.default_rng(seed)) if is_bad else Line(ticks) for seed in (1, 2)]
    return float(energy_j(*Loop(kind, a_servo(stiffness_n_m), HOGAN, lines[0], lines[1]).run(n, _tapping)).min())


@pytest.mark.parametrize("kind", ["wave", "tdpa"])
@pytest.mark.parametrize(
    ("stiffness_n_m", "ticks", "is_bad"),
    [(400.0, 25, False), (400.0, 100, True), (1500.0, 50, False), (1500.0, 25, True), (1500.0, 100, True)],
)
def test_no_more_energy_comes_back_to_the_hand_than_it_put_in(
    kind: str, stiffness_n_m: float, ticks: int, is_bad: bool
) -> None:
    """With loss, jitter and duplicates, too: never below -0.1 mJ."""
    assert _least_j(kind, stiffness_n_m, ticks, is_bad) >= -1e-4


def test_without_passivity_the_hand_is_driven() -> None:
    assert _least_j("position_force", 1500.0, 25, False, 2000) < -40e-3


@given(st.lists(st.tuples(TRIPLE, TRIPLE, st.floats(0, 2)), min_size=1, max_size=30))
def test_the_arms_port_of_waves_sends_no_energy_that_it_did_not_get(rows: list[tuple[Vector, Vector, float]]) -> None:
    """Also where the set point takes another step than asked for."""
    arm, left_j = WaveArm(20.0, PERIOD_S, 400.0), 0.0
    for incoming, stretch_m, share in rows:
        step = scaled(arm.step(incoming, stretch_m), share)
        outgoing, force = arm.moved(stretch_m, step)
        left_j += 0.5 * PERIOD_S * (dot(incoming, incoming) - dot(outgoing, outgoing)) - dot(force, step)
        if dot(force, step) <= 0.5 * PERIOD_S * dot(incoming, incoming):  # else the spring took it by itself
            assert left_j >= -1e-9 or outgoing == (0.0, 0.0, 0.0)


@given(TRIPLE, TRIPLE, st.floats(0, 1))
def test_a_step_of_the_arm_works_no_more_than_was_received(step_m: Vector, stretch_m: Vector, room_j: float) -> None:
    """Where a shorter step can do that at all."""
    arm = PassiveArm(400.0, ReceivedEnergy(1.0, PERIOD_S, credit_j=room_j))
    step, stretch = scaled(step_m, 1e-3), scaled(stretch_m, 1e-3)
    taken = arm.step(step, stretch)
    force = scaled(plus(stretch, scaled(step, 0.5)), 400.0)
    _, mean = arm.moved(stretch, taken)
    least = min(
        dot(scaled(plus(stretch, scaled(one, 0.5)), 400.0), one)
        for one in (plus(step, scaled(force, -beta)) for beta in np.linspace(0, 0.01, 2001).tolist())
    )
    assert dot(mean, taken) <= max(room_j, least) + 1e-9


def test_each_wave_is_used_once_and_a_missing_one_is_zero() -> None:
    queue = WaveQueue()
    queue.put((1.0, 0.0, 0.0))
    queue.put((2.0, 0.0, 0.0))
    assert [queue.take()[0] for _ in range(4)] == [1.0, 2.0, 0.0, 0.0]
    assert queue.n_missing == 2
    assert is_too_strong((3.0, 0.0, 0.0), 4.0)
    assert not is_too_strong((2.0, 0.0, 0.0), 4.0)


def test_an_account_begins_with_the_first_total_and_believes_no_more_than_the_power_limit() -> None:
    account = ReceivedEnergy(power_max_w=2.0, period_s=0.001)
    assert account.take(5.0, 0)
    assert account.credit_j == 0.0
    assert account.take(5.002, 1_000_000)
    assert account.credit_j == pytest.approx(0.002)
    assert not account.take(6.0, 2_000_000)
    assert account.take(5.1, 500_000)  # older: no news
    assert account.take(0.0, 3_000_000)  # the sender was started anew
    assert account.credit_j == pytest.approx(0.002)
