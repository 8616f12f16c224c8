import numpy as np
import pytest

from tests.patient_side.identification.known_systems import Array, Noisy, four_states
from tis.patient_side.identification.hankel import triangular_factor
from tis.patient_side.identification.order import (
    Candidate,
    OrderChoice,
    choose_order,
    energy_order,
    is_static,
    largest_candidate,
    log_gap_order,
    smallest_sufficient,
)
from tis.patient_side.identification.subspace import FutureBlocks, completed, shifted
from tis.patient_side.identification.subspace_methods import moesp_subspace
from tis.patient_side.identification.trials import Scaling
from tis.patient_side.identification.validation import split_trials


def choose(u: Array, y: Array, block_rows: int) -> OrderChoice:
    scaled = Scaling.of([(u, y)]).scaled([(u, y)])
    first, last = split_trials(scaled)
    factor = triangular_factor(first, block_rows)
    found = moesp_subspace(FutureBlocks.of(factor, block_rows, u.shape[1], y.shape[1]))
    largest = largest_candidate(found.rank, block_rows, y.shape[1])
    fitted = [completed(*shifted(found, n), first) for n in range(largest + 1)]
    candidates = [Candidate.of(each.space, each.x0, first, block_rows) for each in fitted]
    return choose_order(candidates, len(first[0][0]), last, found.singular_values, 2 * block_rows)


@pytest.mark.parametrize(
    ("values", "order"),
    [([8.5, 1.5], 1), ([8.4, 1.6], 2), ([1.0] * 20, 17), ([5.0], 1), ([0.0, 0.0], 0)],
)
def test_energy_takes_the_fewest_values_with_85_per_cent(values: list[float], order: int) -> None:
    assert energy_order(np.array(values)) == order


@pytest.mark.parametrize(
    ("values", "order"),
    [
        ([100.0, 90.0, 1.0, 0.9], 2),
        ([10.0, 1.0, 0.9, 0.8], 1),
        ([3.0, 2.0, 1e-13, 1e-19], 2),  # the larger ratio is between two zeros
        ([0.0, 0.0], 0),
    ],
)
def test_log_gap_stands_before_the_largest_ratio(values: list[float], order: int) -> None:
    assert log_gap_order(np.array(values)) == order


@pytest.mark.parametrize(
    ("errors", "order"),
    [
        ((0.9, 0.5, 0.40, 0.39), 2),  # within 5 %
        ((0.9, 0.5, 0.42, 0.39), 3),
        ((0.050, 0.002, 0.001), 0),  # within five per cent of what holding errs
        ((0.052, 0.050, 0.001), 1),
        ((3.0, float("inf")), 0),
    ],
)
def test_the_smallest_order_that_is_as_good_as_the_best(errors: tuple[float, ...], order: int) -> None:
    assert smallest_sufficient(errors) == order


def test_a_clean_system_has_its_order_by_gap_and_validation() -> None:
    rng, system = np.random.default_rng(0), four_states()
    u = rng.normal(size=(600, 2))
    choice = choose(u, system.simulate(u, rng.normal(size=4)), 8)
    assert (choice.log_gap, choice.criterion, choice.validation) == (4, 4, 4)
    assert len(choice.fits) == 5  # beyond 4 there are no singular values but rounding


def test_a_noisy_system_has_its_order_by_validation() -> None:
    rng = np.random.default_rng(1)
    noisy = Noisy(four_states(), 0.05 * np.eye(4), 0.05 * np.eye(3))
    choice = choose(*noisy.run(1500, rng), 8)
    assert (choice.criterion, choice.validation) == (4, 4)
    assert len(choice.fits) == len(choice.predictions) == 13
    assert choice.fits[4].error < 0.2


def test_a_gain_is_static_and_noise_is_not() -> None:
    rng = np.random.default_rng(2)
    u = rng.normal(size=(600, 2))
    gain = choose(u, u @ np.array([[0.5, 0.1], [0.0, 0.5]]), 5)
    assert gain.validation == 0
    assert is_static(0, gain.fits[0])
    unrelated = choose(u, rng.normal(size=(600, 2)), 5)
    assert not is_static(unrelated.validation, unrelated.fits[unrelated.validation])
    assert not is_static(1, gain.fits[0])
