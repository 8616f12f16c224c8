from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.identification.known_systems import (
    REAL_TRIALS,
    Array,
    four_states,
    markov,
    real_recording,
    sorted_eigenvalues,
)
from tis.common.channels import Hand
from tis.common.errors import DataError
from tis.common.scenario.identification import Identification
from tis.patient_side.identification.hankel import block_hankel
from tis.patient_side.identification.identify import identify_with_orders
from tis.patient_side.identification.moesp_paper import paper_model, paper_subspace
from tis.patient_side.linear_system import StateSpace


def clean_trials(*lengths: int, seed: int = 0, at_rest: bool = True) -> list[tuple[Array, Array]]:
    rng, system = np.random.default_rng(seed), four_states()
    trials = []
    for length in lengths:
        u = rng.normal(size=(length, 2))
        trials.append((u, system.simulate(u, np.zeros(4) if at_rest else rng.normal(size=4))))
    return trials


def min_max(signal: Array) -> Array:
    return np.asarray((signal - signal.min(axis=0)) / np.ptp(signal, axis=0))


@pytest.mark.parametrize("at_rest", [True, False])
@pytest.mark.parametrize("depth", [3, 6, 10])
def test_a_noise_free_system_comes_back_with_its_eigenvalues_and_markov_parameters(depth: int, at_rest: bool) -> None:
    found, warnings = paper_subspace(clean_trials(400, at_rest=at_rest), depth)
    space, true = paper_model(found, 4), four_states()
    assert sorted_eigenvalues(space.A) == pytest.approx(sorted_eigenvalues(true.A), abs=1e-10)
    assert markov(space, 20) == pytest.approx(markov(true, 20), abs=1e-10)
    assert found.rank == 4
    assert found.singular_values[4] < 1e-10 * found.singular_values[3]
    assert warnings == ()


def test_no_column_crosses_from_one_trial_into_the_next() -> None:
    found, _ = paper_subspace(clean_trials(*[30] * 12, at_rest=False), 6)
    assert markov(paper_model(found, 4), 20) == pytest.approx(markov(four_states(), 20), abs=1e-9)


def test_min_max_without_centring_costs_one_more_state_with_eigenvalue_one() -> None:
    ((u, y),) = clean_trials(500)
    found, _ = paper_subspace([(min_max(u), min_max(y))], 8)
    assert found.rank == 5
    space = paper_model(found, 5)
    true = sorted_eigenvalues(np.block([[four_states().A, np.zeros((4, 1))], [np.zeros((1, 4)), np.eye(1)]]))
    assert sorted_eigenvalues(space.A) == pytest.approx(true, abs=1e-9)
    # inputs cannot move that state, so the responses are the system's in units of the ranges
    scale = np.ptp(y, axis=0)[:, None] / np.ptp(u, axis=0)
    assert markov(space, 20) * scale == pytest.approx(markov(four_states(), 20), abs=1e-9)


def test_the_singular_values_are_those_of_the_outputs_less_what_inputs_explain() -> None:
    # by orthogonal projection instead of LQ; the printed listing does not divide by the number of columns
    rng = np.random.default_rng(4)
    u, y = rng.normal(size=(200, 2)), rng.normal(size=(200, 3))
    found, _ = paper_subspace([(u, y)], 5)
    U, Y = block_hankel(u, 5), block_hankel(y, 5)
    residual = Y - Y @ np.linalg.pinv(U) @ U
    assert found.singular_values == pytest.approx(np.linalg.svd(residual, compute_uv=False), rel=1e-9)


@settings(max_examples=15)
@given(
    inputs=st.lists(st.floats(1e-4, 1e4), min_size=2, max_size=2),
    outputs=st.lists(st.floats(1e-4, 1e4), min_size=3, max_size=3),
)
def test_units_of_clean_signals_change_the_model_as_they_must(inputs: list[float], outputs: list[float]) -> None:
    ((u, y),) = clean_trials(300)
    scaled = (min_max(u * inputs), min_max(y * outputs))
    plain, _ = paper_subspace([(min_max(u), min_max(y))], 6)
    other, _ = paper_subspace([scaled], 6)
    assert other.singular_values[:5] == pytest.approx(plain.singular_values[:5], rel=1e-6)
    assert markov(paper_model(other, 5), 10) == pytest.approx(markov(paper_model(plain, 5), 10), abs=1e-6)


def test_an_unstable_system_stays_unstable() -> None:
    rng = np.random.default_rng(2)
    system = StateSpace(np.array([[1.02]]), np.eye(1), np.eye(1), np.zeros((1, 1)))
    u = rng.normal(size=(120, 1))
    found, _ = paper_subspace([(u, system.simulate(u))], 5)
    assert paper_model(found, 1).spectral_radius() == pytest.approx(1.02)


def test_two_sinusoids_do_not_excite_and_the_rank_is_named() -> None:
    t = np.arange(400.0)[:, None]
    u = np.sin(0.3 * t) + np.sin(0.8 * t + 1)
    with pytest.raises(DataError, match=r"persistently exciting: its Hankel matrix has rank 4 of 10"):
        paper_subspace([(u, np.vstack([np.zeros((1, 1)), u[:-1]]))], 10)


def test_weak_excitation_is_a_warning_with_the_condition() -> None:
    rng = np.random.default_rng(1)
    t = np.arange(400.0)[:, None]
    u = np.sin(0.3 * t) + 1e-5 * rng.normal(size=t.shape)
    _, (warning,) = paper_subspace([(u, np.vstack([np.zeros((1, 1)), u[:-1]]))], 4)
    assert f"condition {np.linalg.cond(block_hankel(u, 4)):.2g}" in warning


PAPER_S = Identification(method="moesp_paper", block_rows=10, order=10)


@pytest.mark.parametrize("hand", ["left", "right"])
@pytest.mark.parametrize("trial", REAL_TRIALS)
def test_like_named_arms_give_the_papers_knee_and_an_eigenvalue_at_one(
    jigsaws_dir: Path, trial: str, hand: Hand
) -> None:
    whole = real_recording(jigsaws_dir, trial, same_name=True)
    identified = identify_with_orders([whole], hand, PAPER_S, "")
    model = identified.model
    assert (model.order, len(model.singular_values), identified.orders.energy) in [(10, 30, 3), (10, 30, 4)]
    assert 0.999 < model.spectral_radius < 1.013
    assert max(model.fit_pct) < -100  # it cannot simulate
    assert any("used as it is" in w for w in model.warnings) == (model.spectral_radius >= 1)


def test_true_arms_have_flat_singular_values_that_the_energy_rule_counts(jigsaws_dir: Path) -> None:
    whole = real_recording(jigsaws_dir, "Suturing_D002").head(1240)
    for hand in (part.hand for part in whole.hands):
        identified = identify_with_orders([whole], hand, Identification(method="moesp_paper"), "")
        values = identified.model.singular_values
        assert (identified.orders.energy, identified.model.order, len(values)) == (23, 23, 30)
        assert identified.orders.validation == 0
        assert values[1] < 4 * values[-1]
        assert values[0] < 0.05  # of like-named arms it is near 30
