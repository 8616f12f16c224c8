"""The Kalman update, against filterpy carried from step to step, and against the conditional of a joint Gaussian."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter

from tis.patient_side.filters.kalman import joseph_update, kalman_predict, kalman_update
from tis.patient_side.linear_system import Array


def drawn(n: int, p: int, seed: int) -> tuple[Array, ...]:
    """Return F, Q, H, R, drive and the measurements of six steps."""
    rng = np.random.default_rng(seed)
    noises = [rng.normal(size=(size, size)) for size in (n, p)]
    Q, R = (root @ root.T for root in noises)
    return rng.normal(size=(n, n)), Q, rng.normal(size=(p, n)), R, rng.normal(size=n), rng.normal(size=(6, p))


@pytest.mark.parametrize("n", [1, 2, 3, 7, 15, 24])
@pytest.mark.parametrize("p", [1, 3])
def test_both_steps_are_filterpys_to_the_last_bit(n: int, p: int) -> None:
    F, Q, H, R, drive, outputs = drawn(n, p, 10 * n + p)
    reference = KalmanFilter(dim_x=n, dim_z=p)
    reference.x, reference.F, reference.Q, reference.H, reference.R = np.zeros(n), F, Q, H, R
    x, P = np.zeros(n), np.eye(n)
    for k, y in enumerate(outputs):
        reference.predict(u=drive if k % 2 else None, B=np.eye(n))
        reference.update(y)
        x, P = kalman_predict(x, P, F, Q, np.eye(n).dot(drive) if k % 2 else None)
        x, P = kalman_update(x, P, y, H, R)
        assert np.array_equal(x, reference.x)
        assert np.array_equal(P, reference.P)


@pytest.mark.parametrize("seed", range(3))
def test_the_update_is_the_conditional_of_the_joint_gaussian(seed: int) -> None:
    F, Q, H, R, x, (y, *_) = drawn(5, 3, seed)
    P = F @ F.T + Q
    joint = np.block([[P, P @ H.T], [H @ P, H @ P @ H.T + R]])
    weights = np.linalg.solve(joint[5:, 5:], joint[5:, :5]).T
    mean, covariance = kalman_update(x, P, y, H, R)
    assert np.allclose(mean, x + weights @ (y - H @ x), rtol=1e-8)
    assert np.allclose(covariance, joint[:5, :5] - weights @ joint[5:, :5], atol=1e-8 * np.max(P))


def test_josephs_form_is_the_error_covariance_of_any_gain() -> None:
    F, Q, H, R, x, (y, *_) = drawn(4, 2, 0)
    P, K = F @ F.T + Q, np.ones((4, 2)) / 7
    mean, covariance = joseph_update(x, P, y, H, R, K)
    # The error x - x^ is (I - K H) times that of the prediction less K v, two independent terms.
    both = np.hstack([np.eye(4) - K @ H, -K])
    assert np.allclose(covariance, both @ np.block([[P, np.zeros((4, 2))], [np.zeros((2, 4)), R]]) @ both.T)
    assert np.allclose(mean, x + K @ (y - H @ x))


def test_a_scalar_update_diverges_without_an_exception() -> None:
    with np.errstate(divide="ignore", invalid="ignore"):
        mean, _ = kalman_update(
            np.ones(1), np.zeros((1, 1)), np.ones(1), np.ones((1, 1)), np.zeros((1, 1)), np.reciprocal
        )
    assert np.isnan(mean).all()
