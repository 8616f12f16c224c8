from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.identification.known_systems import Array, Noisy, four_states, markov, sorted_eigenvalues
from tis.common.errors import DataError
from tis.patient_side.identification.hankel import block_hankel
from tis.patient_side.identification.linear_model import LinearModel
from tis.patient_side.identification.subspace_methods import METHODS

SLICOT = Path(__file__).resolve().parents[4] / "shared" / "data" / "slicot" / "IB01AD.dat"


def identify_moesp(trials: Sequence[tuple[Array, Array]], block_rows: int, order: int) -> LinearModel:
    return METHODS["moesp"]([u for u, _ in trials], [y for _, y in trials], order, block_rows)


def clean_trials(*lengths: int, seed: int = 0) -> tuple[list[tuple[Array, Array]], list[Array]]:
    rng, system = np.random.default_rng(seed), four_states()
    trials, starts = [], []
    for length in lengths:
        u, x0 = rng.normal(size=(length, 2)) * [3.0, 0.01], rng.normal(size=4)
        trials.append((u, system.simulate(u, x0)))
        starts.append(x0)
    return trials, starts


def test_a_noise_free_system_comes_back_with_its_eigenvalues_and_markov_parameters() -> None:
    trials, _ = clean_trials(400)
    result = identify_moesp(trials, 6, 4)
    true = four_states()
    assert sorted_eigenvalues(result.space.A) == pytest.approx(sorted_eigenvalues(true.A), abs=1e-10)
    assert markov(result.space, 20) == pytest.approx(markov(true, 20), abs=1e-10)
    assert pytest.approx(true.D, abs=1e-10) == result.space.D
    assert result.provenance.singular_values[4] < 1e-10 * result.provenance.singular_values[3]
    assert result.warnings == ()


def test_the_initial_state_of_each_trial_gives_its_free_response() -> None:
    trials, starts = clean_trials(300, 90, 250)
    result = identify_moesp(trials, 6, 4)
    still = np.zeros((12, 2))
    for x0, start in zip(result.x0, starts, strict=True):
        assert result.space.simulate(still, x0) == pytest.approx(four_states().simulate(still, start), abs=1e-9)


def test_no_column_crosses_from_one_trial_into_the_next() -> None:
    # each trial starts anew: a column over the border would belong to no linear system
    trials, _ = clean_trials(*[40] * 12)
    result = identify_moesp(trials, 6, 4)
    assert markov(result.space, 20) == pytest.approx(markov(four_states(), 20), abs=1e-9)


def test_the_eigenvalues_are_consistent_under_process_noise() -> None:
    rng = np.random.default_rng(5)
    noisy = Noisy(four_states(), 0.8 * rng.normal(size=(4, 4)), 0.3 * np.eye(3))
    true = sorted_eigenvalues(noisy.space.A)

    def error(n_rows: int) -> float:
        errors = []
        for _ in range(4):
            found = sorted_eigenvalues(identify_moesp([noisy.run(n_rows, rng)], 8, 4).space.A)
            errors.append(float(np.max(np.abs(found - true))))
        return float(np.mean(errors))

    few, many = error(600), error(15_000)
    assert many < 0.5 * few
    assert many < 0.03


def test_the_published_slicot_example_to_four_decimals() -> None:
    if not SLICOT.is_file():
        pytest.skip("no SLICOT example data here: ../shared/data/slicot beside the checkout")
    numbers = np.array([float(word) for word in SLICOT.read_text().split("\n", 2)[2].split()])
    u, y = numbers[:1000, None], numbers[1000:2000, None]
    result = identify_moesp([(u, y)], 15, 4)
    published = [69.8841, 14.9963, 3.6675, 1.9677, 0.3000, 0.2078]
    assert result.provenance.singular_values[:6] * y.std() == pytest.approx(published, abs=5.1e-5)
    eigenvalues = [0.4758 - 0.1999j, 0.4758 + 0.1999j, 0.7456, 0.9610]
    assert sorted_eigenvalues(result.space.A) == pytest.approx(eigenvalues, abs=1e-4)


def test_order_zero_is_the_least_squares_gain() -> None:
    rng = np.random.default_rng(3)
    u = rng.normal(size=(300, 2))
    y = u @ np.array([[0.5, 0.1, 0.0], [0.0, 0.4, -0.2]]) + 0.1 * rng.normal(size=(300, 3))
    result = identify_moesp([(u, y)], 4, 0)
    assert pytest.approx((np.linalg.pinv(u) @ y).T) == result.space.D
    assert result.space.A.shape == (0, 0)
    assert result.space.C.shape == (3, 0)
    assert result.x0[0].shape == (0,)


@settings(max_examples=15, deadline=None)
@given(
    inputs=st.lists(st.floats(1e-5, 1e5), min_size=2, max_size=2),
    outputs=st.lists(st.floats(1e-5, 1e5), min_size=3, max_size=3),
)
def test_units_change_the_model_as_they_must(inputs: list[float], outputs: list[float]) -> None:
    rng = np.random.default_rng(8)
    u, y = Noisy(four_states(), 0.1 * np.eye(4), 0.1 * np.eye(3)).run(400, rng)
    plain = identify_moesp([(u, y)], 5, 4)
    scaled = identify_moesp([(u * inputs, y * outputs)], 5, 4)
    gains = np.array(outputs)[:, None] / np.array(inputs)
    assert markov(scaled.space, 10) / gains == pytest.approx(markov(plain.space, 10), rel=1e-6, abs=1e-7)
    assert scaled.provenance.singular_values == pytest.approx(plain.provenance.singular_values, rel=1e-6)


def test_the_trials_are_not_modified_even_when_read_only() -> None:
    trials, _ = clean_trials(300)
    before = [(u.copy(), y.copy()) for u, y in trials]
    for u, y in trials:
        u.flags.writeable = y.flags.writeable = False
    identify_moesp(trials, 6, 4)
    for (u, y), (u_before, y_before) in zip(trials, before, strict=True):
        assert np.array_equal(u, u_before)
        assert np.array_equal(y, y_before)


def test_an_unstable_system_is_made_stable_and_says_so() -> None:
    rng = np.random.default_rng(2)
    u = rng.normal(size=(120, 1))
    y = np.zeros((120, 1))
    for k in range(119):
        y[k + 1] = 1.02 * y[k] + u[k]
    result = identify_moesp([(u, y)], 5, 1)
    assert result.space.A[0, 0] == pytest.approx(1 / 1.02)
    assert [w for w in result.warnings if "unstable, spectral radius 1.02:" in w]
    # refitted: B is the least-squares one for the A that is used, by an independent regression
    response = np.zeros(120)
    for k in range(119):
        response[k + 1] = result.space.A[0, 0] * response[k] + u[k, 0]
    states = result.space.A[0, 0] ** np.arange(120)
    wanted = np.linalg.lstsq(np.column_stack([states, response, u[:, 0]]), y[:, 0])[0]
    found = [
        float((result.space.C @ result.x0[0])[0]),
        float((result.space.C @ result.space.B)[0, 0]),
        float(result.space.D[0, 0]),
    ]
    assert found == pytest.approx(wanted, rel=1e-8)


def test_two_sinusoids_do_not_excite_and_the_rank_is_named() -> None:
    t = np.arange(400.0)[:, None]
    u = np.sin(0.3 * t) + np.sin(0.8 * t + 1)
    y = np.vstack([np.zeros((1, 1)), u[:-1]])
    with pytest.raises(DataError, match=r"persistently exciting: its Hankel matrix has rank 4 of 20"):
        identify_moesp([(u, y)], 10, 1)


def test_weak_excitation_is_a_warning_with_the_condition() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(400.0)[:, None]
    u = np.sin(0.3 * t) + 1e-5 * rng.normal(size=t.shape)
    y = np.vstack([np.zeros((1, 1)), u[:-1]])
    (warning,) = identify_moesp([(u, y)], 4, 1).warnings
    condition = np.linalg.cond(block_hankel(u, 8))
    assert f"condition {condition:.2g}" in warning


@pytest.mark.parametrize("order", [-1, 16])
def test_an_order_that_the_block_rows_cannot_show_is_refused(order: int) -> None:
    trials, _ = clean_trials(300)
    with pytest.raises(DataError, match=rf"order: must lie in 0\.\.15.*\(got {order}\)"):
        identify_moesp(trials, 6, order)
