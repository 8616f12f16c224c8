import numpy as np
import pytest

from tests.patient_side.identification.known_systems import Array, innovation_markov, sorted_eigenvalues
from tests.patient_side.movements import movement_model
from tis.common.errors import DataError
from tis.patient_side.identification.hankel import block_hankel
from tis.patient_side.identification.stochastic_moesp import (
    InnovationsForm,
    identify,
    n_hankel_columns,
    output_factor,
    realise,
    stochastic_subspace,
)


def known(n: int = 4) -> InnovationsForm:
    model = movement_model(n, seed=1)
    return InnovationsForm(model.A, model.C, model.K, model.Re)


def outputs_of(form: InnovationsForm, n_rows: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    e = rng.normal(size=(n_rows + 300, 3)) @ np.linalg.cholesky(form.Re).T
    x, y = np.zeros(len(form.A)), np.empty_like(e)
    for k in range(len(e)):
        y[k] = form.C @ x + e[k]
        x = form.A @ x + form.K @ e[k]
    return y[300:]


def markov_error(found: InnovationsForm, true: InnovationsForm) -> float:
    return float(
        np.linalg.norm(innovation_markov(found, 12) - innovation_markov(true, 12))
        / np.linalg.norm(innovation_markov(true, 12))
    )


def found_in(outputs: list[Array], order: int, block_rows: int) -> InnovationsForm:
    model = identify(None, outputs, order, block_rows)
    return InnovationsForm(model.space.A, model.space.C, model.noise.gain, model.noise.R)


def test_errors_fall_with_the_rows_as_chance_does() -> None:
    """Consistency: 16 times the rows, a quarter of the error; with a fixed bias it would stay."""
    true = known()
    few = np.mean([markov_error(found_in([outputs_of(true, 1000, s)], 4, 10), true) for s in range(6)])
    many = np.mean([markov_error(found_in([outputs_of(true, 16_000, s)], 4, 10), true) for s in range(6)])
    assert many < 0.35 * few
    assert many < 0.2
    found = found_in([outputs_of(true, 16_000, 7)], 4, 10)
    assert np.allclose(found.Re, true.Re, rtol=0.1, atol=0.05 * np.max(true.Re))
    assert np.max(np.abs(sorted_eigenvalues(found.A) - sorted_eigenvalues(true.A))) < 0.05


def test_its_innovations_are_white_and_as_large_as_they_should_be() -> None:
    true = known()
    found = found_in([outputs_of(true, 8000, 1)], 4, 10)
    x, errors = np.zeros(4), []
    for y in outputs_of(true, 4000, 2):
        e = y - found.C @ x
        errors.append(e)
        x = found.A @ x + found.K @ e
    e = np.array(errors[100:])
    root = np.linalg.inv(np.linalg.cholesky(found.Re))
    white = e @ root.T
    assert np.trace(white.T @ white) / white.size == pytest.approx(1.0, abs=0.03)
    for lag in (1, 2, 5):
        assert np.max(np.abs(white[lag:].T @ white[:-lag] / len(white))) < 4 / np.sqrt(len(white))


def test_noise_free_movements_give_their_eigenvalues() -> None:
    """Free decays from many initial states: nothing but the dynamics is in the outputs."""
    true, rng = known(), np.random.default_rng(3)
    trials = []
    for _ in range(12):
        x = rng.normal(size=4)
        rows = []
        for _ in range(40):
            rows.append(true.C @ x)
            x = true.A @ x
        trials.append(np.array(rows))
    found = identify(None, trials, 4, 5)
    assert np.max(np.abs(sorted_eigenvalues(found.space.A) - sorted_eigenvalues(true.A))) < 1e-8
    assert found.provenance.singular_values[4] < 1e-9 * found.provenance.singular_values[0]


def test_no_column_reaches_over_a_trials_border() -> None:
    rng = np.random.default_rng(0)
    trials = [rng.normal(size=(n, 3)) + offset for n, offset in ((60, 0.0), (700, 5.0), (9, -3.0))]
    columns = np.hstack([block_hankel(y, 10) for y in trials])
    factor = output_factor(trials, 5)
    assert np.allclose(factor.T @ factor, columns @ columns.T, rtol=1e-10, atol=1e-8)
    assert n_hankel_columns(trials, 5) == columns.shape[1]
    continued = output_factor(trials[1:], 5, output_factor(trials[:1], 5))
    assert np.allclose(continued.T @ continued, factor.T @ factor, rtol=1e-10, atol=1e-8)


def test_the_model_is_stable_where_the_shift_of_the_observability_matrix_is_not() -> None:
    rng = np.random.default_rng(5)
    y = np.cumsum(np.cumsum(rng.normal(size=(600, 3)), axis=0) * 0.02, axis=0)
    y -= y.mean(axis=0)
    found = stochastic_subspace(output_factor([y], 8), 8, n_hankel_columns([y], 8))
    for order in (3, 9, 15):
        form, _ = realise(found, order)
        assert np.max(np.abs(np.linalg.eigvals(form.A))) < 1
        assert np.max(np.abs(np.linalg.eigvals(form.A - form.K @ form.C))) < 1


def test_units_of_the_axes_play_no_part() -> None:
    y = outputs_of(known(), 3000, 4)
    scale = np.array([1e-3, 1.0, 1e4])
    found, scaled = found_in([y], 4, 8), found_in([y * scale], 4, 8)
    assert np.allclose(
        innovation_markov(scaled, 6), scale[:, None] * innovation_markov(found, 6) / scale, rtol=1e-6, atol=1e-9
    )


@pytest.mark.parametrize(("order", "rule"), [(0, "1..12"), (13, "1..12")])
def test_orders_that_block_rows_cannot_show_are_refused(order: int, rule: str) -> None:
    with pytest.raises(DataError, match=rule):
        identify(None, outputs_of(known(), 400, 1), order, 5)


def test_more_states_than_the_past_tells_of_are_refused() -> None:
    t = np.arange(300)[:, None]
    y = np.hstack([np.sin(0.3 * t), np.cos(0.3 * t), np.sin(0.3 * t + 1)])
    with pytest.raises(DataError, match="at most 2"):
        identify(None, y, 6, 5)


@pytest.mark.parametrize("spoilt", [np.nan, np.inf])
def test_what_is_not_finite_is_refused(spoilt: float) -> None:
    y = outputs_of(known(), 400, 1)
    y[7, 1] = spoilt
    with pytest.raises(DataError, match="finite"):
        identify(None, y, 4, 5)
