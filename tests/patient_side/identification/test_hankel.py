import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.patient_side.identification.hankel import block_hankel, fill_hankel

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
@given(**sizes, columns=st.integers(1, 9))
def test_a_matrix_that_is_filled_is_the_first_columns(n: int, d: int, s: int, columns: int) -> None:
    signal = np.arange(n * d, dtype=float).reshape(n, d)
    whole = block_hankel(signal, s)
    part = np.empty((s * d, min(columns, whole.shape[1])))
    fill_hankel(part, signal)
    assert np.array_equal(part, whole[:, :columns])


def test_the_matrix_is_a_copy() -> None:
    signal = np.zeros((5, 2))
    block_hankel(signal, 2)[:] = 1.0
    assert not signal.any()
