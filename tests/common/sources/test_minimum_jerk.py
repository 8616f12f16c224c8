import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.sources.minimum_jerk import Movements, minimum_jerk
from tis.common.sources.trajectory import Array


def test_the_polynomial_solves_the_boundary_value_problem() -> None:
    # the Euler-Lagrange equation of minimum jerk is x'''''' = 0: a quintic with rest at both ends
    def derivatives(p: float) -> list[list[float]]:
        powers = range(6)
        return [
            [p**k for k in powers],
            [k * p ** max(k - 1, 0) for k in powers],
            [k * (k - 1) * p ** max(k - 2, 0) for k in powers],
        ]

    coefficients = np.linalg.solve(np.array(derivatives(0.0) + derivatives(1.0)), [0, 0, 0, 1, 0, 0])
    phase = np.linspace(0, 1, 101)
    assert minimum_jerk(phase) == pytest.approx(np.polynomial.polynomial.polyval(phase, coefficients), abs=1e-12)


def test_no_other_smooth_path_has_less_jerk() -> None:
    phase = np.linspace(0, 1, 401)

    def jerk(path: Array) -> float:
        return float(np.sum(np.diff(path, 3) ** 2))

    best = jerk(minimum_jerk(phase))
    for k in (1, 2, 3):
        # keeps position, velocity and acceleration at both ends
        bump = (phase * (1 - phase)) ** 3 * np.cos(k * np.pi * phase)
        for size in (-1.0, 1.0):
            assert jerk(minimum_jerk(phase) + size * bump) > best


def test_before_and_after_a_movement_there_is_rest() -> None:
    assert minimum_jerk(np.array([-5.0, 0.0, 0.5, 1.0, 7.0])).tolist() == [0.0, 0.0, 0.5, 1.0, 1.0]


def test_a_single_movement_peaks_half_way_at_15_eighths_of_its_mean_speed() -> None:
    movement = Movements(np.array([1.0]), np.array([2.0]), np.array([[10.0], [40.0]]))
    t_s = np.arange(0, 4, 1e-4)
    position = movement.at(t_s)[:, 0]
    speed = np.diff(position) / 1e-4
    assert position[t_s <= 1.0] == pytest.approx(10.0)
    assert position[t_s >= 3.0] == pytest.approx(40.0)
    assert speed.max() == pytest.approx(15 / 8 * 30 / 2, rel=1e-6)
    assert t_s[np.argmax(speed)] == pytest.approx(2.0, abs=1e-3)


@settings(max_examples=40, deadline=None)
@given(data=st.lists(st.tuples(st.floats(0, 1), st.floats(0.05, 3), st.floats(-9, 9)), min_size=1, max_size=12))
def test_overlapping_movements_add_up(data: list[tuple[float, float, float]]) -> None:
    steps_s, durations_s, places = (np.array(values) for values in zip(*data, strict=True))
    onset_s = np.cumsum(steps_s)
    target = np.concatenate([[1.0], places])[:, np.newaxis]
    t_s = np.linspace(-1, 20, 400)
    plain = np.full(400, 1.0)
    for i, t0 in enumerate(onset_s):
        p = np.minimum(np.maximum(t_s - t0, 0) / durations_s[i], 1)
        plain += (target[i + 1, 0] - target[i, 0]) * (10 * p**3 - 15 * p**4 + 6 * p**5)
    assert Movements(onset_s, durations_s, target).at(t_s)[:, 0] == pytest.approx(plain, abs=1e-9)
