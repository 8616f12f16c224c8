"""What the subspace methods share and where they differ. SLICOT's example and `moesp` alone: test_moesp."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pytest
from scipy.linalg import sqrtm

from tests.patient_side.identification.known_systems import Array, Noisy, four_states, markov, sorted_eigenvalues
from tis.common.errors import DataError
from tis.patient_side.identification.hankel import block_hankel, triangular_factor
from tis.patient_side.identification.moesp_paper import paper_model, paper_subspace
from tis.patient_side.identification.subspace import FutureBlocks, Subspace
from tis.patient_side.identification.subspace_methods import METHODS, SUBSPACE_METHODS, cva_subspace, n4sid_subspace
from tis.patient_side.linear_system import StateSpace

Run = Callable[[int, np.random.Generator], tuple[Array, Array]]

SUBSPACE = pytest.mark.parametrize("name", SUBSPACE_METHODS)


def noisy_run() -> tuple[Array, Array]:
    rng = np.random.default_rng(3)
    return Noisy(four_states(), 0.5 * rng.normal(size=(4, 4)), 0.3 * np.eye(3)).run(300, rng)


@SUBSPACE
def test_noise_free_trials_give_eigenvalues_and_markov_parameters(name: str) -> None:
    rng, true = np.random.default_rng(0), four_states()
    inputs = [rng.normal(size=(n, 2)) * [3.0, 0.01] for n in (200, 40, 250)]
    outputs = [true.simulate(u, rng.normal(size=4)) for u in inputs]
    found = METHODS[name](inputs, outputs, 4, 6)
    assert sorted_eigenvalues(found.space.A) == pytest.approx(sorted_eigenvalues(true.A), abs=1e-10)
    assert markov(found.space, 20) == pytest.approx(markov(true, 20), abs=1e-10)
    assert found.warnings == ()
    assert (found.provenance.method, found.provenance.n_rows, found.provenance.n_trials) == (name, 490, 3)
    still = np.zeros((12, 2))
    for u, y, x0 in zip(inputs, outputs, found.x0, strict=True):
        # what each trial starts with is told by its outputs without what its inputs do
        free = y[:12] - true.simulate(u[:12])
        assert found.space.simulate(still, x0) == pytest.approx(free, abs=1e-8)


@SUBSPACE
def test_the_result_holds_the_noise_in_innovations_form(name: str) -> None:
    found = METHODS[name](*noisy_run(), 4, 6)
    assert pytest.approx(found.noise.gain @ found.noise.R) == found.noise.S
    assert pytest.approx(found.noise.gain @ found.noise.R @ found.noise.gain.T) == found.noise.Q
    assert np.max(np.abs(np.linalg.eigvals(found.space.A - found.noise.gain @ found.space.C))) < 1
    assert pytest.approx(found.scaling.output) == noisy_run()[1].std(axis=0)


def explained(found: Subspace) -> Array:
    """Return the projector on the first four directions, whatever basis spans them."""
    basis = np.linalg.qr(found.left[:, :4])[0]
    return np.asarray(basis @ basis.T)


def data_matrices(u: Array, y: Array, s: int) -> tuple[Array, Array, Array]:
    inputs, outputs = block_hankel(u, 2 * s), block_hankel(y, 2 * s)
    m, p = u.shape[1], y.shape[1]
    return inputs[s * m :], np.vstack([inputs[: s * m], outputs[: s * p]]), outputs[s * p :]


def blocks_of(u: Array, y: Array, s: int) -> FutureBlocks:
    return FutureBlocks.of(triangular_factor([(u, y)], s), s, u.shape[1], y.shape[1])


def test_n4sid_is_the_oblique_projection_by_its_definition() -> None:
    u, y = noisy_run()
    U_f, W_p, Y_f = data_matrices(u, y, 4)
    coefficients = np.linalg.lstsq(np.vstack([W_p, U_f]).T, Y_f.T)[0].T
    left, values, _ = np.linalg.svd(coefficients[:, : len(W_p)] @ W_p)
    found = n4sid_subspace(blocks_of(u, y, 4))
    assert found.singular_values == pytest.approx(values[:12])
    assert explained(found) == pytest.approx(left[:, :4] @ left[:, :4].T, abs=1e-8)


def test_cva_is_the_canonical_correlation_by_its_definition() -> None:
    u, y = noisy_run()
    U_f, W_p, Y_f = data_matrices(u, y, 4)
    away = np.eye(U_f.shape[1]) - np.linalg.pinv(U_f) @ U_f
    future, past = Y_f @ away, W_p @ away
    root = np.real(sqrtm(future @ future.T))
    whiten_past = np.linalg.inv(np.real(sqrtm(past @ past.T)))
    left, correlations, _ = np.linalg.svd(np.linalg.solve(root, future @ past.T) @ whiten_past)
    found = cva_subspace(blocks_of(u, y, 4))
    assert found.singular_values == pytest.approx(correlations, abs=1e-8)
    assert correlations[0] <= 1
    wanted = np.linalg.qr(root @ left[:, :4])[0]
    assert explained(found) == pytest.approx(wanted @ wanted.T, abs=1e-6)


def process_noise(n_rows: int, rng: np.random.Generator) -> tuple[Array, Array]:
    L = 0.8 * np.random.default_rng(5).normal(size=(4, 4))
    return Noisy(four_states(), L, 0.3 * np.eye(3)).run(n_rows, rng)


def coloured_noise(n_rows: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the clean system measured with noise that is a first-order process of its own."""
    u, e, v = rng.normal(size=(n_rows, 2)), rng.normal(size=(n_rows, 3)), np.zeros((n_rows, 3))
    for k in range(1, n_rows):
        v[k] = 0.9 * v[k - 1] + 1.5 * e[k]
    return u, four_states().simulate(u) + v


class Error(NamedTuple):
    """Largest errors of an eigenvalue and of an element of the first 20 Markov parameters: rms over repetitions."""

    eigenvalue: float
    markov: float


def error(run: Run, model: Callable[[Array, Array], StateSpace], n_rows: int) -> Error:
    true, squares = four_states(), []
    for seed in range(5):
        found = model(*run(n_rows, np.random.default_rng(100 + seed)))
        poles = np.max(np.abs(sorted_eigenvalues(found.A) - sorted_eigenvalues(true.A)))
        squares.append((float(poles) ** 2, float(np.max(np.abs(markov(found, 20) - markov(true, 20)))) ** 2))
    return Error(*np.sqrt(np.mean(squares, axis=0)).tolist())


def by(name: str) -> Callable[[Array, Array], StateSpace]:
    return lambda u, y: METHODS[name](u, y, 4, 8).space


def ordinary_moesp(u: Array, y: Array) -> StateSpace:
    return paper_model(paper_subspace([(u, y)], 16)[0], 4)


@pytest.mark.parametrize("name", ["moesp", "n4sid", "cva"])
def test_process_noise_leaves_an_error_that_data_wear_down(name: str) -> None:
    few, many = error(process_noise, by(name), 1000), error(process_noise, by(name), 16_000)
    assert many.eigenvalue < few.eigenvalue / 4
    assert many.markov < few.markov / 4
    assert many.eigenvalue < 0.03


def test_ordinary_moesp_keeps_its_error_under_process_noise() -> None:
    few, many = error(process_noise, ordinary_moesp, 1000), error(process_noise, ordinary_moesp, 16_000)
    assert many.eigenvalue > few.eigenvalue / 2
    assert many.eigenvalue > 0.2
    assert many.markov > few.markov / 2


def test_coloured_noise_needs_past_inputs_as_instruments() -> None:
    of_run = partial(error, coloured_noise)
    assert of_run(by("moesp"), 16_000).eigenvalue > 0.5
    assert of_run(by("n4sid"), 16_000).eigenvalue > 0.5
    few, many = of_run(by("pi_moesp"), 1000), of_run(by("pi_moesp"), 16_000)
    assert many.eigenvalue < few.eigenvalue / 4
    assert many.markov < few.markov / 4
    assert many.eigenvalue < 0.15


def test_one_input_shows_no_more_states_to_past_inputs_than_block_rows() -> None:
    u, y = noisy_run()
    with pytest.raises(DataError, match=r"order: must lie in 0\.\.4, block rows x inputs \(got 5\)"):
        METHODS["pi_moesp"](u[:, :1], y, 5, 4)
    assert METHODS["moesp"](u[:, :1], y, 5, 4).space.order == 5


def test_unequal_numbers_of_trials_are_refused() -> None:
    u, y = noisy_run()
    with pytest.raises(DataError, match=r"output: must have as many trials as the input, 2 \(got 1\)"):
        METHODS["moesp"]([u, u], [y], 4, 6)
