import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.filters.input_path import continued, damped_steps, forecast_steps, known_point, newest_velocity
from tis.patient_side.movement_models import InputForecast
from tis.patient_side.playout import SourceBuffer


def buffer_of(samples: dict[int, float]) -> SourceBuffer:
    """A buffer whose positions are (value, 2 value, 0)."""
    buffer = SourceBuffer(depth=100)
    for index, value in samples.items():
        buffer.add(index, np.array([value, 2.0 * value, 0.0]))
    return buffer


@given(st.floats(0.0, 1.0), st.integers(0, 200))
@settings(max_examples=100, deadline=None)
def test_damped_steps_is_the_sum_of_powers(damping: float, horizon: int) -> None:
    summed = sum(damping**k for k in range(1, horizon + 1))
    assert damped_steps(damping, horizon) == pytest.approx(summed, rel=1e-9, abs=1e-12)


def test_damped_steps_takes_fractions() -> None:
    assert damped_steps(0.5, 0.5) == pytest.approx(0.5 * (1.0 - 0.5**0.5) / 0.5)
    assert damped_steps(1.0, 2.25) == 2.25
    assert damped_steps(0.9, 0.0) == 0.0


@given(st.floats(0.0, 0.96), st.floats(0.98, 1.0), st.integers(0, 200))
@settings(max_examples=100, deadline=None)
def test_a_forecast_goes_and_comes_back_as_it_is_defined(damping: float, persistence: float, horizon: int) -> None:
    summed = sum(damping**k * persistence ** (horizon - k) for k in range(1, horizon + 1))
    forecast = InputForecast(damping, 1, np.zeros((0, 3)), persistence)
    assert forecast_steps(forecast, horizon) == pytest.approx(summed, rel=1e-7, abs=1e-9)


def test_a_forecast_that_comes_back_ends_where_it_began() -> None:
    assert forecast_steps(InputForecast(0.9, 1, np.zeros((0, 3)), 0.99), 2000) == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize(
    ("samples", "span", "expected"),
    [
        ({0: 0.0, 1: 1.0, 2: 4.0}, 1, 3.0),
        ({0: 0.0, 1: 1.0, 2: 4.0}, 2, 2.0),
        ({0: 0.0, 3: 6.0}, 1, 2.0),  # the wanted sample is lost: the true distance counts
        ({0: 0.0, 3: 5.0, 4: 6.0}, 3, 1.5),  # 0 and 3 lie 1 and 2 from the wanted 1
        ({0: 0.0, 3: 5.0, 4: 6.0}, 2, 1.0),  # 0 and 3 lie 2 and 1 from the wanted 2
        ({0: 0.0, 2: 5.0, 3: 6.0}, 2, 2.0),  # 0 and 2 are equally far from the wanted 1: the older
        ({7: 6.0, 8: 7.0}, 5, 1.0),  # none is older
        ({8: 7.0}, 1, 0.0),
    ],
)
def test_velocity_at_the_newest_sample(samples: dict[int, float], span: int, expected: float) -> None:
    assert newest_velocity(buffer_of(samples), span) == pytest.approx([expected, 2.0 * expected, 0.0])


@given(st.sets(st.integers(0, 40), min_size=1), st.integers(0, 40))
@settings(max_examples=100, deadline=None)
def test_known_points_are_interpolated(arrived: set[int], index: int) -> None:
    samples = {i: (i * 7919 % 101) / 101 for i in arrived}
    if index > max(arrived):
        return
    point = known_point(buffer_of(samples), index)
    indices = sorted(arrived)
    assert point.position_m[0] == pytest.approx(np.interp(index, indices, [samples[i] for i in indices]))
    assert point.distance == min(abs(index - i) for i in arrived)


def test_continuation_follows_the_formula() -> None:
    forecast = InputForecast(damping=0.5, velocity_span=1, growth_m=np.zeros((0, 3)))
    path = continued(buffer_of({4: 1.0, 5: 2.0}), forecast, 3)
    assert path == pytest.approx([2.0 + 0.5 + 0.25 + 0.125, 2.0 * 2.875, 0.0])
