import numpy as np
import pytest

from tis.patient_side.identification.input_delay import delayed, estimate_delay


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize("dead", [0, 1, 5])
def test_dead_time_beyond_one_sample_is_found_for_each_input(noise: float, dead: int) -> None:
    rng = np.random.default_rng(dead)
    u, y = rng.normal(size=(1200, 2)), np.zeros((1200, 1))
    for k in range(10, 1200):
        y[k] = 0.8 * y[k - 1] + u[k - 1 - dead, 0] + 0.5 * u[k - 3, 1] + noise * rng.normal()
    assert estimate_delay([(u, y / y.std())], 10) == (dead, 2)


def test_inputs_before_the_first_row_are_unknown() -> None:
    acting = delayed(np.arange(8.0).reshape(4, 2), (2, 0))
    assert np.array_equal(acting, np.array([[np.nan, 1], [np.nan, 3], [0, 5], [2, 7]]), equal_nan=True)
