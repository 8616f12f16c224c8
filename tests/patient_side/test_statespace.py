import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.linear_system import StateSpace


@settings(max_examples=40, deadline=None)
@given(n=st.integers(0, 4), m=st.integers(0, 3), p=st.integers(1, 3), n_rows=st.integers(0, 100))
def test_a_simulation_in_blocks_is_that_of_a_plain_loop(n: int, m: int, p: int, n_rows: int) -> None:
    rng = np.random.default_rng(100 * n_rows + 10 * n + m)
    A = rng.normal(size=(n, n))
    A *= 0.95 / np.max(np.abs(np.linalg.eigvals(A)), initial=1e-9)
    space = StateSpace(A, rng.normal(size=(n, m)), rng.normal(size=(p, n)), rng.normal(size=(p, m)))
    u, x0 = rng.normal(size=(n_rows, m)), rng.normal(size=n)
    x, y = x0, np.empty((n_rows, p))
    for k in range(n_rows):
        y[k] = space.C @ x + space.D @ u[k]
        x = A @ x + space.B @ u[k]
    assert space.simulate(u, x0) == pytest.approx(y, abs=1e-10)
    assert np.array_equal(space.simulate(u), space.simulate(u, np.zeros(n)))
