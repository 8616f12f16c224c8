"""The simulated operator against its differential equation."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tis.common.coupling.stability import Limb
from tis.common.vector import ZERO
from tis.surgeon_side.operator import Operator


@pytest.mark.parametrize("limb", [Limb(0.9, 6.0, 568.0), Limb(2.1, 2.5, 10.0), Limb(0.1, 40.0, 100.0)])
def test_the_hand_moves_as_its_differential_equation_says(limb: Limb) -> None:
    hand, state = Operator(limb, 0.01), [0.0, 0.0]
    for force_n in (1.0, 1.0, -2.0, 0.0, 0.5, 0.5):
        hand.move((0.0, force_n, 0.0))

        def motion(_: float, y: NDArray[np.float64], f: float = force_n) -> list[float]:
            return [y[1], (f - limb.damping_ns_m * y[1] - limb.stiffness_n_m * y[0]) / limb.mass_kg]

        state = solve_ivp(motion, (0.0, 0.01), state, rtol=1e-10, atol=1e-14).y[:, -1].tolist()
        assert (hand.off_m[1], hand.speed_m_s[1]) == pytest.approx((state[0], state[1]), rel=1e-7, abs=1e-12)


def test_a_hand_that_feels_nothing_is_where_it_intends_to_be() -> None:
    hand = Operator(Limb(0.9, 6.0, 568.0), 0.001)
    for _ in range(100):
        hand.move(ZERO)
    assert hand.off_m == ZERO


def test_a_hand_at_rest_under_a_force_is_off_by_force_over_stiffness() -> None:
    hand = Operator(Limb(0.9, 60.0, 500.0), 0.001)
    for _ in range(5000):
        hand.move((0.0, 0.0, -2.0))
    assert hand.off_m[2] == pytest.approx(-2.0 / 500.0, rel=1e-9)
