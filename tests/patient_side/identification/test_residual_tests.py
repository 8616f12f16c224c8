import numpy as np

from tests.patient_side.identification.known_systems import Array
from tis import identify
from tis.patient_side.identification.residual_tests import residual_tests


def test_a_right_model_is_rejected_as_often_as_the_level_says() -> None:
    rng = np.random.default_rng(2)
    found = []
    for _ in range(300):
        u = np.convolve(rng.normal(size=540), [1, 0.8, 0.3], mode="valid")[:500, None]  # a coloured input
        tests = residual_tests(rng.normal(size=(500, 2)), u, 10)
        found.append(np.concatenate([tests.whiteness_p, tests.independence_p]) < 0.05)
    assert np.all(np.abs(np.mean(found, axis=0) - 0.05) < 0.04)


def second_order(n_rows: int) -> tuple[Array, Array]:
    rng = np.random.default_rng(6)
    u, y = rng.normal(size=(n_rows, 1)), np.zeros((n_rows, 1))
    for k in range(2, n_rows):
        y[k] = 1.5 * y[k - 1] - 0.7 * y[k - 2] + u[k - 1] + 0.1 * rng.normal()
    return u, y


def test_too_low_an_order_is_rejected_and_the_right_one_passes() -> None:
    u, y = second_order(3000)
    right, low = (identify(u[:2000], y[:2000], order=n, horizon=8) for n in (2, 1))
    assert right.residual_tests(u[2000:], y[2000:]).passed()
    assert not low.residual_tests(u[2000:], y[2000:]).passed()


def test_cross_correlation_shows_the_lag_of_an_unmodelled_input() -> None:
    rng = np.random.default_rng(7)
    u = rng.normal(size=(2000, 2))
    e = rng.normal(size=(2000, 1))
    e[3:, 0] += 0.5 * u[:-3, 1]
    tests = residual_tests(e, u, 6)
    assert int(np.argmax(tests.cross_correlation)) == 3 * 2 + 1  # lag 3, input 1
    assert tests.independence_p[0] < 1e-6
