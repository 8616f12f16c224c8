import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from tis.common.sources.synthetic import servo
from tis.common.sources.trajectory import Array


def path(t_s: Array) -> Array:
    return np.column_stack([0.3 + 0.02 * np.sin(3.0 * t_s), 0.01 * t_s, np.full(len(t_s), -0.1)])


@pytest.mark.parametrize(("bandwidth_hz", "damping"), [(0.5, 0.7), (2.0, 1.0), (8.0, 0.2), (5.0, 3.0)])
def test_it_solves_the_differential_equation(bandwidth_hz: float, damping: float) -> None:
    t_s, w = np.linspace(0.0, 3.0, 91), 2.0 * np.pi * bandwidth_hz

    def slope(t: float, state: Array) -> Array:
        x, v = state.reshape(2, 3)
        return np.concatenate([v, w**2 * (path(np.array([t]))[0] - x) - 2.0 * damping * w * v])

    begun = np.concatenate([path(np.zeros(1))[0], np.zeros(3)])
    solved = solve_ivp(slope, (0.0, 3.0), begun, t_eval=t_s, rtol=1e-9, atol=1e-12, max_step=0.01)
    assert np.max(np.abs(servo(path, t_s, bandwidth_hz, damping) - solved.y[:3].T)) < 2e-6


@settings(max_examples=20, deadline=None)
@given(until_s=st.floats(0.0, 2.0), more_s=st.floats(0.0, 3.0))
def test_what_comes_later_changes_nothing(until_s: float, more_s: float) -> None:
    t_s = np.linspace(-0.01, until_s, 50)
    longer = np.concatenate([t_s, [until_s + more_s]])
    assert np.array_equal(servo(path, t_s, 3.0, 0.7), servo(path, longer, 3.0, 0.7)[:-1])


def test_before_the_beginning_and_on_a_path_that_stays_it_rests() -> None:
    still = servo(lambda t_s: np.full((len(t_s), 2), 0.25), np.array([-0.02, 0.0, 0.5, 9.0]), 4.0, 0.7)
    assert still == pytest.approx(np.full((4, 2), 0.25), abs=1e-12)
