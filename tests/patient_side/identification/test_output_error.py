import numpy as np
import pytest

from tests.patient_side.identification.known_systems import Array, four_states
from tis.patient_side.identification.output_error import fit_inputs, fit_inputs_by_innovations, fit_response


def regression_by_simulation(A: Array, C: Array, u: Array) -> Array:
    """Return the regressors column by column: a simulation by plain loop for each unit element of x0, B and D."""
    n, m, p = len(A), u.shape[1], len(C)
    columns = []
    for element in range(n + n * m + p * m):
        unit = np.zeros(n + n * m + p * m)
        unit[element] = 1.0
        x, B, D = unit[:n], unit[n : n + n * m].reshape(m, n).T, unit[n + n * m :].reshape(p, m)
        y = np.empty((len(u), p))
        for k in range(len(u)):
            y[k] = C @ x + D @ u[k]
            x = A @ x + B @ u[k]
        columns.append(y.reshape(-1))
    return np.column_stack(columns)


@pytest.mark.parametrize("n_rows", [20, 64, 2100])  # within a block, whole blocks, more than is held at once
def test_one_trial_is_the_least_squares_of_unit_simulations(n_rows: int) -> None:
    rng, system = np.random.default_rng(n_rows), four_states()
    u, y = rng.normal(size=(n_rows, 2)), rng.normal(size=(n_rows, 3))
    B, D, (x0,) = fit_inputs(system.A, system.C, [(u, y)])
    wanted = np.linalg.lstsq(regression_by_simulation(system.A, system.C, u), y.reshape(-1))[0]
    assert np.concatenate([x0, B.T.reshape(-1), D.reshape(-1)]) == pytest.approx(wanted, rel=1e-7, abs=1e-9)


def test_by_innovations_the_filters_errors_are_least() -> None:
    rng, system = np.random.default_rng(8), four_states()
    u, y, gain = rng.normal(size=(60, 2)), rng.normal(size=(60, 3)), 0.02 * rng.normal(size=(4, 3))

    def errors(x: Array, B: Array, D: Array) -> Array:
        found = np.empty_like(y)
        for k in range(len(u)):
            found[k] = y[k] - system.C @ x - D @ u[k]
            x = system.A @ x + B @ u[k] + gain @ found[k]
        return found.reshape(-1)

    def unstacked(values: Array) -> tuple[Array, Array, Array]:
        return values[:4], values[4:12].reshape(2, 4).T, values[12:].reshape(3, 2)

    at_zero = errors(*unstacked(np.zeros(18)))
    columns = [at_zero - errors(*unstacked(unit)) for unit in np.eye(18)]
    wanted = np.linalg.lstsq(np.column_stack(columns), at_zero)[0]
    B, D, (x0,) = fit_inputs_by_innovations(system.A, system.C, gain, [(u, y)])
    assert np.concatenate([x0, B.T.reshape(-1), D.reshape(-1)]) == pytest.approx(wanted, rel=1e-7, abs=1e-9)


def test_several_trials_share_b_and_d_and_have_their_own_start() -> None:
    rng, system = np.random.default_rng(4), four_states()
    trials = [(rng.normal(size=(n, 2)), rng.normal(size=(n, 3))) for n in (50, 3, 70)]
    B, D, starts = fit_inputs(system.A, system.C, trials)
    blocks = []
    for i, (u, _) in enumerate(trials):
        plain = regression_by_simulation(system.A, system.C, u)
        own = np.zeros((len(plain), 12))
        own[:, 4 * i : 4 * i + 4] = plain[:, :4]
        blocks.append(np.hstack([own, plain[:, 4:]]))
    target = np.concatenate([y.reshape(-1) for _, y in trials])
    wanted = np.linalg.lstsq(np.vstack(blocks), target)[0]
    found = np.concatenate([*starts, B.T.reshape(-1), D.reshape(-1)])
    assert found == pytest.approx(wanted, rel=1e-7, abs=1e-9)


def test_a_response_starts_from_rest_and_has_no_feedthrough() -> None:
    rng, system = np.random.default_rng(6), four_states()
    trials = [(rng.normal(size=(n, 2)), rng.normal(size=(n, 3))) for n in (80, 45)]
    columns = np.vstack([regression_by_simulation(system.A, system.C, u)[:, 4:12] for u, _ in trials])
    wanted = np.linalg.lstsq(columns, np.concatenate([y.reshape(-1) for _, y in trials]))[0]
    assert fit_response(system.A, system.C, trials).T.reshape(-1) == pytest.approx(wanted, rel=1e-7)
