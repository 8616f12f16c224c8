import numpy as np
import pytest

from tests.patient_side.identification.known_systems import Array
from tis.common.errors import DataError
from tis.patient_side.identification.trials import Scaling, check_trials
from tis.patient_side.linear_system import StateSpace


def sound(n_rows: int = 60) -> tuple[Array, Array]:
    rng = np.random.default_rng(0)
    return rng.normal(size=(n_rows, 2)), rng.normal(size=(n_rows, 1))


def faults(*trials: tuple[Array, Array], block_rows: int = 5, held_back: float = 0.0) -> list[str]:
    with pytest.raises(DataError) as caught:
        check_trials(trials, block_rows, None, held_back)
    return [str(fault) for fault in caught.value.faults]


def test_sound_trials_pass() -> None:
    check_trials([sound(), sound()], 5)


def test_transposed_arrays_are_named() -> None:
    u, y = sound()
    assert faults((u.T, y)) == [
        "trial 1: input: must have one row per sample, and no fewer rows than columns: too short, or transposed"
        " (got (2, 60))"
    ]


def test_unequal_lengths_are_named() -> None:
    u, y = sound()
    assert faults((u, y[:-1])) == ["trial 1: output: must have as many rows as the input, 60 (got 59)"]


def test_a_vector_is_no_signal() -> None:
    u, y = sound()
    assert faults((u, y[:, 0])) == ["trial 1: output: must have the shape (samples, channels) (got (60,))"]


def test_all_values_that_are_not_finite_are_reported_at_once() -> None:
    (u1, y1), (u2, y2) = sound(), sound()
    y1[7, 0] = np.nan
    u2[3] = np.inf
    assert faults((u1, y1), (u2, y2)) == [
        "trial 1: output: must be finite: 1 values are not, the first in row 7",
        "trial 2: input: must be finite: 2 values are not, the first in row 3",
    ]


def test_constant_signals_are_named() -> None:
    u, y = sound()
    assert faults((np.column_stack([u[:, 0], np.full(60, 0.1)]), 0 * y)) == [
        "identification: input 1: must move, it is constant in the training rows: "
        "at rest it needs sensor_noise_mm: 0.01",
        "identification: output 0: must move, it is constant in the training rows: "
        "at rest it needs sensor_noise_mm: 0.01",
    ]


@pytest.mark.parametrize("factor", [1e-200, 1e200])
def test_units_in_which_squares_are_no_numbers_are_refused(factor: float) -> None:
    u, y = sound()
    u[0], y[0] = 3.0, 3.0  # so that none of the columns is small
    rule = "must move by more than 1e-70 and stay below 1e+70: use another unit"
    assert faults((u, factor * y)) == [f"identification: output 0: {rule}"]
    check_trials([(u, 1e-60 * y)], 5)


def test_too_few_rows_name_the_rows_needed() -> None:
    # 2 s (m + p) = 30 columns, N - 9 of them in N rows
    (fault,) = faults(sound(38))
    assert "5 block rows, 2 inputs and 1 outputs need 39 rows in one trial: 30 Hankel columns, here 29" in fault
    assert fault.endswith("(got 38)")
    check_trials([sound(39)], 5)


def test_rows_set_aside_are_needed_on_top() -> None:
    # 55 rows leave 55 - 16 = 39
    (fault,) = faults(sound(54), held_back=0.3)
    assert "need 55 rows in one trial, 30 % of them to validate on: 30 Hankel columns, here 29" in fault
    check_trials([sound(55)], 5, None, 0.3)


def test_short_trials_count_with_the_columns_that_they_have() -> None:
    check_trials([sound(24), sound(24)], 5)
    (fault,) = faults(sound(24), sound(23))
    assert "here 29" in fault


def test_no_trial_and_unlike_trials_are_refused() -> None:
    assert faults() == ["identification: trials: needs at least one trial"]
    u, y = sound()
    assert faults((u, y), (u, u)) == ["identification: trials: all must have the same numbers of inputs and outputs"]


def test_scaling_is_about_each_trials_own_mean_and_is_undone() -> None:
    (u1, y1), (u2, y2) = sound(), sound()
    trials = [(u1, y1), (u2 + 100.0, 5.0 * y2 - 3.0)]
    scaling = Scaling.of(trials)
    centred = np.concatenate([u1 - u1.mean(axis=0), u2 - u2.mean(axis=0)])
    assert scaling.input == pytest.approx(centred.std(axis=0))
    space = StateSpace(np.diag([0.5, 0.2]), np.ones((2, 2)), np.ones((1, 2)), np.ones((1, 2)))
    scaled = scaling.scaled([(u1, y1)])[0][0]
    expected = space.simulate(scaled) * scaling.output
    assert scaling.unscaled(space).simulate(u1) == pytest.approx(expected)
