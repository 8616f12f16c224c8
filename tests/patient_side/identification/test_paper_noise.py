import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from tests.patient_side.identification.known_systems import Noisy, four_states
from tis.common.errors import DataError
from tis.patient_side.identification.moesp_paper import empirical_noise, first_run
from tis.patient_side.linear_system import StateSpace

ONE = np.eye(1)


def test_three_samples_worked_by_hand() -> None:
    # x[k+1] = x[k]/2 + u[k], z = 2 x; the feedthrough 7 takes no part. Q = R = 1, x = 0 and P = 1 at the first row.
    space = StateSpace(0.5 * ONE, ONE, 2 * ONE, 7 * ONE)
    u, y = np.array([[1.0], [0.0], [3.0]]), np.array([[4.0], [8.0], [2.0]])
    # k = 2: x- = 0/2 + 1 = 1, P- = 1/4 + 1 = 5/4, K = (5/2) / (5 + 1) = 5/12, x = 1 + 5/12 (8 - 2) = 7/2,
    #        P = (1 - 5/6) 5/4 = 5/24
    # k = 3: x- = 7/4 + 0, P- = 5/96 + 1 = 101/96, K = (202/96) / (404/96 + 1) = 202/500, e = 2 - 7/2 = -3/2,
    #        x = 7/4 - 303/500 = 1.144
    assert first_run(space, u, y, 1.0, 1.0)[:, 0] == pytest.approx([0.0, 3.5, 1.144])
    # r_y = 4 - 0, 8 - 7, 2 - 2.288; r_x = 3.5 - 0 - u[2] = 3.5, 1.144 - 1.75 - u[3] = -3.606
    noise = empirical_noise(space, [(u, y)], 1.0, 1.0)
    assert noise.R[0, 0] == pytest.approx((16 + 1 + 0.288**2) / 3)
    assert noise.Q[0, 0] == pytest.approx((3.5**2 + 3.606**2) / 2)
    assert noise.S.tolist() == [[0.0]]


def test_the_first_run_is_a_textbook_filters() -> None:
    space = four_states()
    u, y = Noisy(space, 0.1 * np.eye(4), 0.2 * np.eye(3)).run(60, np.random.default_rng(0))
    kf = KalmanFilter(dim_x=4, dim_z=3, dim_u=2)
    kf.x, kf.P = np.zeros(4), np.eye(4)
    kf.F, kf.B, kf.H, kf.Q, kf.R = space.A, space.B, space.C, 0.3 * np.eye(4), 0.7 * np.eye(3)
    states = [kf.x.copy()]
    for k in range(1, 60):
        kf.predict(u=u[k - 1])
        kf.update(y[k])
        states.append(kf.x.copy())
    assert first_run(space, u, y, 0.3, 0.7) == pytest.approx(np.array(states), abs=1e-10)


def test_only_the_ratio_of_the_guesses_counts_once_the_start_is_forgotten() -> None:
    u, y = Noisy(four_states(), 0.1 * np.eye(4), 0.2 * np.eye(3)).run(300, np.random.default_rng(1))
    one, other = (first_run(four_states(), u, y, 1e-3 * s, 2e-3 * s) for s in (1.0, 50.0))
    assert one[150:] == pytest.approx(other[150:], abs=1e-9)
    assert one[150:] != pytest.approx(first_run(four_states(), u, y, 1e-3, 2e-2)[150:], abs=1e-2)


def test_trials_are_pooled_by_their_rows_and_steps() -> None:
    noisy, rng = Noisy(four_states(), 0.1 * np.eye(4), 0.2 * np.eye(3)), np.random.default_rng(2)
    trials = [noisy.run(40, rng), noisy.run(90, rng)]
    pooled = empirical_noise(noisy.space, trials, 1e-3, 1e-3)
    one, other = (empirical_noise(noisy.space, [trial], 1e-3, 1e-3) for trial in trials)
    assert pytest.approx((40 * one.R + 90 * other.R) / 130) == pooled.R
    assert pytest.approx((39 * one.Q + 89 * other.Q) / 128) == pooled.Q
    assert np.array_equal(pooled.Q, pooled.Q.T)


def test_an_unstable_model_that_can_be_observed_is_held_by_its_measurements() -> None:
    space = StateSpace(np.diag([1.5, 0.9]), np.ones((2, 1)), np.array([[1.0, 1.0], [1.0, -1.0]]), np.zeros((2, 1)))
    u, y = np.random.default_rng(3).normal(size=(2000, 1)), np.zeros((2000, 2))
    assert np.max(np.abs(first_run(space, u, y, 1e-3, 1e-3))) < 10


def test_a_run_that_diverges_is_refused_with_the_order_and_the_radius() -> None:
    space = StateSpace(np.diag([3.0, 3.0]), np.ones((2, 1)), np.ones((1, 2)), np.zeros((1, 1)))  # not observable
    u = np.ones((900, 1))
    with pytest.raises(DataError, match=r"order: the first run for Q and R diverges, spectral radius 3: .*\(got 2\)"):
        empirical_noise(space, [(u, u)], 1e-3, 1e-3)
