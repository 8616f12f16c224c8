import numpy as np
import pytest
from scipy.optimize import minimize

from tests.patient_side.identification.known_systems import Array, Noisy, four_states
from tis.patient_side.identification.noise import SENSOR_RESOLUTION_M, estimate_noise, innovations
from tis.patient_side.identification.subspace_methods import METHODS
from tis.patient_side.linear_system import NoiseModel, StateSpace


def kalman_innovations(space: StateSpace, noise: NoiseModel, u: Array, y: Array, P: Array) -> tuple[Array, Array]:
    """Return the innovations (N, p) and their normalised squares (N,) of a textbook filter with correlated noise."""
    A, B, C, D = space.A, space.B, space.C, space.D
    x, errors, squares = np.zeros(space.order), [], []
    for k in range(len(u)):
        e = y[k] - C @ x - D @ u[k]
        Re = C @ P @ C.T + noise.R
        K = (A @ P @ C.T + noise.S) @ np.linalg.inv(Re)
        x = A @ x + B @ u[k] + K @ e
        P = A @ P @ A.T + noise.Q - K @ Re @ K.T
        errors.append(e)
        squares.append(e @ np.linalg.solve(Re, e))
    return np.array(errors), np.array(squares)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_filter_on_the_estimate_is_consistent_and_as_good_as_the_true_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    true = Noisy(four_states(), 0.2 * rng.normal(size=(4, 4)), 0.3 * rng.normal(size=(3, 3)))
    training, fresh = true.run(3000, rng), true.run(3000, rng)
    model = METHODS["moesp"](*training, 4, 10)
    noise, warnings = estimate_noise(model.space, model.x0, [training], 10)
    assert warnings == ()
    found, squares = kalman_innovations(model.space, noise, *fresh, np.zeros((4, 4)))
    right = NoiseModel(true.L @ true.L.T, true.M @ true.M.T, np.zeros((4, 3)))
    best, _ = kalman_innovations(true.space, right, *fresh, np.eye(4))
    assert 0.8 < squares[100:].mean() / 3 < 1.25
    ratio = np.sqrt(np.sum(found[100:] ** 2, axis=0) / np.sum(best[100:] ** 2, axis=0))
    assert np.all(ratio < 1.05)


def test_innovations_are_those_of_the_textbook_filter_at_rest() -> None:
    rng = np.random.default_rng(3)
    true = Noisy(four_states(), 0.1 * np.eye(4), 0.2 * np.eye(3))
    u, y = true.run(300, rng)
    model = METHODS["moesp"](u, y, 4, 6)
    noise, _ = estimate_noise(model.space, [np.zeros(4)], [(u, y)], 6)
    gain = noise.S @ np.linalg.inv(noise.R)
    plain, _ = kalman_innovations(model.space, noise, u, y, np.zeros((4, 4)))
    assert innovations(model.space, gain, [np.zeros(4)], [(u, y)])[0] == pytest.approx(plain, abs=1e-8)


def test_the_joint_covariance_is_positive_semidefinite_and_the_filter_stable() -> None:
    rng = np.random.default_rng(4)
    trials = [Noisy(four_states(), 0.3 * np.eye(4), 0.1 * np.eye(3)).run(n, rng) for n in (200, 30, 400)]
    for order in (1, 2, 4, 7):
        model = METHODS["moesp"]([u for u, _ in trials], [y for _, y in trials], order, 6)
        noise, _ = estimate_noise(model.space, model.x0, trials, 6)
        joint = np.block([[noise.Q, noise.S], [noise.S.T, noise.R]])
        assert np.array_equal(joint, joint.T)
        assert np.linalg.eigvalsh(joint)[0] > -1e-12 * np.linalg.norm(joint)
        gain = noise.S @ np.linalg.inv(noise.R)
        assert np.max(np.abs(np.linalg.eigvals(model.space.A - gain @ model.space.C))) < 1
        one_step = innovations(model.space, gain, model.x0, trials)
        simulated = innovations(model.space, 0 * gain, model.x0, trials)
        assert sum(np.sum(e**2) for e in one_step) < sum(np.sum(r**2) for r in simulated)


def test_no_other_gain_predicts_much_better_even_for_a_model_that_is_too_small() -> None:
    rng = np.random.default_rng(8)
    slow = StateSpace(np.diag([0.99, 0.9, 0.7]), rng.normal(size=(3, 2)), rng.normal(size=(2, 3)), np.zeros((2, 2)))
    trial = Noisy(slow, 0.5 * np.eye(3), 0.1 * np.eye(2)).run(800, rng)
    model = METHODS["moesp"](*trial, 1, 6)
    noise, _ = estimate_noise(model.space, model.x0, [trial], 6)
    gain = noise.S @ np.linalg.inv(noise.R)

    def size(flat: Array) -> float:
        (e,) = innovations(model.space, flat.reshape(1, 2), model.x0, [trial])
        return float(np.linalg.slogdet(e.T @ e / len(e))[1])

    best = minimize(size, gain.reshape(-1), method="Nelder-Mead")
    assert size(gain.reshape(-1)) - best.fun < 0.02
    assert size(np.zeros(2)) - best.fun > 0.5  # there was something to find


def test_a_static_model_has_the_covariance_of_its_residuals_alone() -> None:
    rng = np.random.default_rng(5)
    u = rng.normal(size=(500, 3))
    v = 1e-4 * rng.normal(size=(500, 3))
    static = StateSpace(np.empty((0, 0)), np.empty((0, 3)), np.empty((3, 0)), 0.5 * np.eye(3))
    noise, warnings = estimate_noise(static, [np.empty(0)], [(u, 0.5 * u + v)], 10)
    assert pytest.approx(v.T @ v / 500, rel=1e-9, abs=1e-16) == noise.R
    assert noise.Q.shape == (0, 0)
    assert noise.S.shape == (0, 3)
    assert warnings == ()


def test_noise_below_the_sensors_resolution_is_floored() -> None:
    rng, system = np.random.default_rng(6), four_states()
    u = rng.normal(size=(400, 2))
    y = system.simulate(u)
    model = METHODS["moesp"](u, y, 4, 6)
    noise, _ = estimate_noise(model.space, model.x0, [(u, y)], 6)
    assert pytest.approx(SENSOR_RESOLUTION_M**2 * np.eye(3)) == noise.R
    assert not noise.Q.any()
