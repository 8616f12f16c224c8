import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.patient_side.learned.inputs import (
    LAGS,
    N_AGE,
    N_CONTEXT,
    N_FINE,
    N_LAGS,
    N_STEP,
    Window,
    activity_of,
    age_inputs,
    inputs_of,
    scaled,
)


def window(seed: int = 0, size_m: float = 1e-3, p_present: float = 1.0) -> Window:
    rng = np.random.default_rng(seed)
    way_m = size_m * rng.normal(size=(4, N_LAGS, 3)).cumsum(axis=1)
    way_m -= way_m[:, :1]
    present = rng.random((4, N_LAGS)) < p_present
    present[:, 0] = True
    return Window(way_m, rng.normal(size=(4, N_LAGS)), present)


def test_the_activity_of_a_constant_velocity_is_its_speed_in_units_of_the_usual_one() -> None:
    way_m = -2e-3 * LAGS[None, :, None] * np.array([0.6, 0.0, 0.8])
    found = activity_of(Window(way_m, np.zeros((1, N_LAGS)), np.ones((1, N_LAGS), dtype=np.bool_)), 1e-3)
    assert found == pytest.approx(np.sqrt(4.0 + 0.02))
    assert N_FINE == 64


@given(factor=st.floats(0.1, 10), seed=st.integers(0, 100))
def test_a_faster_copy_of_a_movement_has_the_same_inputs_but_the_activity(factor: float, seed: int) -> None:
    slow, fast = window(seed, 1e-3), window(seed, 1e-3 * factor)
    usual_m = 1e-12  # so that the floor of the activity has no effect
    inputs = [
        inputs_of(np, scaled(each, activity_of(each, usual_m), usual_m, 0.5), zero_lost=False)
        for each in (slow, fast)
    ]
    np.testing.assert_allclose(inputs[0].steps, inputs[1].steps, atol=1e-5)
    np.testing.assert_allclose(inputs[0].context[:, :-1], inputs[1].context[:, :-1], atol=1e-5)
    np.testing.assert_allclose(inputs[1].context[:, -1] - inputs[0].context[:, -1], np.log(factor), atol=1e-5)


def test_the_inputs_of_a_step_are_what_they_are_called() -> None:
    found = window(1, p_present=0.6)
    activity = activity_of(found, 1e-3)
    steps, context = inputs_of(np, scaled(found, activity, 1e-3, 0.5), zero_lost=False)
    assert steps.shape == (4, N_FINE, N_STEP)
    assert context.shape == (4, N_CONTEXT)
    unit = 1e-3 * activity[2]
    increment = (found.way_m[2, 5] - found.way_m[2, 6]) / unit
    expected = [*np.arcsinh(2 * increment), *np.arcsinh(0.25 * found.way_m[2, 5] / unit) / 2]
    expected += [float(found.present[2, 5]), found.gripper_rad[2, 5] / 0.5]
    np.testing.assert_allclose(steps[2, 5], expected, rtol=1e-5)
    np.testing.assert_allclose(context[2, -2:], [-found.gripper_rad[2, N_FINE] / 0.5, np.log(activity[2])], rtol=1e-5)


def test_of_a_lost_sample_nothing_is_read_where_losses_are_zeros() -> None:
    found = window(1, p_present=0.6)
    changed = found._replace(way_m=np.where(found.present[:, :, None], found.way_m, 9.0))
    activity = np.ones(4)
    pairs = [inputs_of(np, scaled(each, activity, 1e-3, 0.5), zero_lost=True) for each in (found, changed)]
    assert np.array_equal(pairs[0].steps, pairs[1].steps)
    lost = ~found.present[:, :N_FINE]
    assert not pairs[0].steps[lost].any()


def test_a_gripper_that_never_moves_is_no_input() -> None:
    steps, context = inputs_of(np, scaled(window(), np.ones(4), 1e-3, 0.0), zero_lost=False)
    assert not steps[:, :, -1].any()
    assert not context[:, -2].any()


def test_the_inputs_of_an_age_are_finite_and_tell_ages_apart() -> None:
    ages = np.array([[0.06, 1.06, 6.0, 150.0]])
    found = age_inputs(ages)
    assert found.shape == (1, 4, N_AGE)
    assert np.isfinite(found).all()
    assert found[0, 2, 0] == 0.0
    assert len(np.unique(found[0], axis=0)) == 4
