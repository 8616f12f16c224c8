import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tis.common.units import sample_instant_ns
from tis.surgeon_side.commanded_arm import MEMORY_S, CommandedArm, Place, Servo

PERIOD_NS = 33_333_333


def _arm(places: list[Place], servo: Servo | None = None) -> CommandedArm:
    arm = CommandedArm(30, servo)
    for index, place in enumerate(places):
        arm.command(index, place)
    return arm


@given(st.lists(st.tuples(*[st.floats(-1, 1)] * 3), min_size=1, max_size=20), st.integers(0, 700_000_000))
def test_an_arm_without_a_servo_moves_linearly_between_commands(places: list[Place], at_ns: int) -> None:
    instants = [sample_instant_ns(i, 30) for i in range(len(places))]
    expected = [np.interp(at_ns, instants, axis) for axis in zip(*places, strict=True)]
    assert _arm(places).at(at_ns) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("damping", [0.3, 1.0, 2.0])
def test_a_servo_solves_its_differential_equation(damping: float) -> None:
    rng = np.random.default_rng(3)
    commands = rng.uniform(-0.02, 0.02, (12, 3))
    arm = _arm([tuple(row) for row in commands.tolist()], Servo(4.0, damping))
    w = 2 * np.pi * 4.0

    def slope(t_s: float, state: np.ndarray) -> np.ndarray:
        reference = commands[min(int(t_s * 30), 11)]
        return np.concatenate([state[3:], w * w * (reference - state[:3]) - 2 * damping * w * state[3:]])

    begun = np.concatenate([commands[0], np.zeros(3)])
    solved = solve_ivp(slope, (0, 0.36), begun, max_step=1e-4, rtol=1e-9, atol=1e-12, dense_output=True)
    for at_s in (0.01, 0.05, 0.1234, 0.2, 0.31, 0.36):
        assert solved.sol is not None
        assert arm.at(round(at_s * 1e9)) == pytest.approx(solved.sol(at_s)[:3], abs=2e-5)


def test_a_missed_sample_keeps_the_command_before_it() -> None:
    arm = CommandedArm(30)
    arm.command(0, (0.0, 0.0, 0.0))
    arm.command(1, (1.0, 0.0, 0.0))
    arm.command(4, (5.0, 0.0, 0.0))
    assert [arm.at(sample_instant_ns(i, 30)) for i in range(5)] == [(x, 0.0, 0.0) for x in (0, 1, 1, 1, 5)]
    assert arm.at(3 * PERIOD_NS + PERIOD_NS // 2 + 1) == pytest.approx((3.0, 0.0, 0.0))


def test_nothing_is_known_before_the_first_command_and_beyond_the_memory() -> None:
    arm = CommandedArm(30)
    assert arm.at(0) is None
    arm.command(90, (1.0, 2.0, 3.0))
    assert arm.at(2_900_000_000) is None
    assert arm.at(3_000_000_000) == (1.0, 2.0, 3.0)
    assert arm.at(9_000_000_000) == (1.0, 2.0, 3.0), "the newest command holds"
    arm.command(90 + 30 * MEMORY_S, (4.0, 5.0, 6.0))
    assert arm.at(3_000_000_000) is None, "a minute is remembered"
    assert arm.at(4_000_000_000) == (1.0, 2.0, 3.0)
    assert arm.at(-(10**18)) is None
