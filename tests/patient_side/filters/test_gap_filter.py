"""The filter with missing channels, against conditioning the joint Gaussian of all states and outputs at once."""

import numpy as np
import pytest

from tis.patient_side.filters.gap_filter import GapFilter
from tis.patient_side.linear_system import NoiseModel, StateSpace


def system() -> tuple[StateSpace, NoiseModel]:
    rng = np.random.default_rng(1)
    A = np.array([[1.0, 0.2], [0.0, 0.9]])
    K, Re = 0.3 * rng.normal(size=(2, 2)), np.array([[0.5, 0.1], [0.1, 0.4]])
    space = StateSpace(A, rng.normal(size=(2, 1)), rng.normal(size=(2, 2)), rng.normal(size=(2, 1)))
    return space, NoiseModel(K @ Re @ K.T, Re, K @ Re)


@pytest.mark.parametrize("missing", [[], [(1, 0)], [(1, 0), (1, 1), (3, 1)]])
def test_it_equals_one_shot_conditioning(missing: list[tuple[int, int]]) -> None:
    space, noise = system()
    rng = np.random.default_rng(2)
    n_rows, u, y = 5, rng.normal(size=(5, 1)), rng.normal(size=(5, 2))
    for k, channel in missing:
        y[k, channel] = np.nan
    # Sources: x0 and each row's [w; v]; states and outputs are linear in them.
    joint = np.block([[noise.Q, noise.S], [noise.S.T, noise.R]])
    size = 2 + 4 * n_rows
    sources = np.zeros((size, size))
    sources[:2, :2] = 4.0 * np.eye(2)
    state, mean, rows, means = np.eye(2, size), np.zeros(2), [], []
    for k in range(n_rows):
        at = 2 + 4 * k
        sources[at : at + 4, at : at + 4] = joint
        rows.append(space.C @ state + np.eye(2, size, at + 2))
        means.append(space.C @ mean + space.D @ u[k])
        state, mean = space.A @ state + np.eye(2, size, at), space.A @ mean + space.B @ u[k]
    seen = np.isfinite(y.reshape(-1))
    H, error = np.concatenate(rows)[seen], (y - np.array(means)).reshape(-1)[seen]
    gain = np.linalg.solve(H @ sources @ H.T, H @ sources @ state.T).T
    kalman = GapFilter(space, noise)
    kalman.P = 4.0 * np.eye(2)
    for k in range(n_rows):
        kalman.update(y[k], u[k])
        kalman.predict()
    assert np.allclose(kalman.x, mean + gain @ error)
    assert np.allclose(kalman.P, state @ sources @ state.T - gain @ H @ sources @ state.T)


def test_a_forecast_leaves_the_filter_where_it_is_and_grows_uncertain() -> None:
    kalman = GapFilter(*system(), delay=(2,))
    kalman.update(np.ones(2), np.ones(1))
    kalman.predict()
    before = kalman.x.copy(), kalman.P.copy()
    _, covariance = kalman.forecast(4, np.ones((4, 1)))
    assert np.array_equal(kalman.x, before[0])
    assert np.array_equal(kalman.P, before[1])
    assert np.trace(covariance[3]) > np.trace(covariance[0])


def test_a_late_input_acts_late() -> None:
    space, noise = system()
    early, late = GapFilter(space, noise), GapFilter(space, noise, delay=(2,))
    u = np.arange(1.0, 7.0)
    for k in range(6):
        early.update(np.full(2, np.nan), [0.0 if k < 2 else u[k - 2]])  # type: ignore[arg-type]
        late.update(np.full(2, np.nan), [u[k]])  # type: ignore[arg-type]
        early.predict()
        late.predict()
    assert np.allclose(early.x, late.x)
