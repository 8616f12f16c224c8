import numpy as np
import pytest
from scipy.linalg import expm

from tis.common.servo import servo_transition


@pytest.mark.parametrize("damping", [0.0, 0.3, 0.999999999, 1.0, 1.000000001, 3.0, 10.0])
@pytest.mark.parametrize("dt_s", [0.0, 0.001, 1 / 30, 0.5])
def test_transition_is_the_matrix_exponential(damping: float, dt_s: float) -> None:
    w = 2 * np.pi * 2.0
    exact = expm(np.array([[0.0, 1.0], [-(w**2), -2.0 * damping * w]]) * dt_s)
    assert np.allclose(servo_transition(2.0, damping, dt_s), exact, rtol=1e-7, atol=1e-9)


def test_transition_of_a_stiff_servo_does_not_overflow() -> None:
    assert np.allclose(servo_transition(1000.0, 10.0, 60.0), 0.0, atol=1e-9)
