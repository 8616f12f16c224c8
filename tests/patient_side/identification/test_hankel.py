import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from patient_side.identification.hankel import block_hankel, hankel_batches

sizes = {"n": st.integers(1, 30), "d": st.integers(1, 4), "s": st.integers(1, 8)}


@settings(max_examples=50, deadline=None)
@given(**sizes)
def test_every_element_is_the_sample_that_the_definition_says(n: int, d: int, s: int) -> None:
    signal = np.arange(n * d, dtype=float).reshape(n, d)
    matrix = block_hankel(signal, s)
    assert matrix.shape == (s * d, max(0, n - s + 1))
    for row in range(matrix.shape[0]):
        for column in range(matrix.shape[1]):
            assert matrix[row, column] == signal[row // d + column, row % d]


@settings(max_examples=50, deadline=None)
@given(**sizes, batch=st.integers(1, 9))
def test_batches_are_the_matrix_cut_into_columns(n: int, d: int, s: int, batch: int) -> None:
    signal = np.arange(n * d, dtype=float).reshape(n, d)
    parts = list(hankel_batches(signal, s, batch))
    assert all(part.shape[1] <= batch for part in parts)
    assert np.array_equal(np.hstack([*parts, np.empty((s * d, 0))]), block_hankel(signal, s))


def test_the_matrix_is_a_copy() -> None:
    signal = np.zeros((5, 2))
    block_hankel(signal, 2)[:] = 1.0
    assert not signal.any()
