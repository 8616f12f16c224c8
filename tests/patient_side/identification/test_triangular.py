import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.patient_side.identification.known_systems import Array
from tis.patient_side.identification.hankel import accumulate, block_hankel, empty_factor, triangular_factor


def trials_of(*lengths: int, seed: int = 0) -> list[tuple[Array, Array]]:
    rng = np.random.default_rng(seed)
    return [(rng.normal(size=(n, 2)), rng.normal(size=(n, 3))) for n in lengths]


@settings(max_examples=25, deadline=None)
@given(d=st.integers(1, 30), sizes=st.lists(st.integers(0, 60), min_size=1, max_size=4))
def test_stretches_give_the_triangle_of_one_qr(d: int, sizes: list[int]) -> None:
    rng = np.random.default_rng(d)
    stretches = [rng.normal(size=(d, n)) for n in sizes]
    factor = empty_factor(d)
    for columns in stretches:
        factor = accumulate(factor, columns.copy())
    assert np.array_equal(factor, np.triu(factor))
    whole = np.hstack([*stretches, np.zeros((d, d))])
    once = np.asarray(np.linalg.qr(whole.T, mode="r"))
    assert factor.T @ factor == pytest.approx(once.T @ once, abs=1e-11 * max(1, sum(sizes)))


def test_what_is_tiny_beside_the_rest_keeps_its_digits() -> None:
    # normal equations would lose a direction 1e-9 as large as another: its square is rounding
    rng = np.random.default_rng(1)
    columns = np.vstack([rng.normal(size=(1, 500)), np.zeros((1, 500))])
    columns[1] = columns[0] + 1e-9 * rng.normal(size=500)
    apart = columns[1] - columns[0] * (columns[0] @ columns[1]) / (columns[0] @ columns[0])
    factor = accumulate(empty_factor(2), columns.copy())
    assert abs(factor[1, 1]) == pytest.approx(np.linalg.norm(apart), rel=1e-5)


def test_no_column_crosses_a_border_and_short_trials_have_none() -> None:
    s, columns = 4, []
    trials = trials_of(120, 5, 1100)  # the second is shorter than a window, the third longer than a stretch
    for u, y in trials:
        inputs, outputs = block_hankel(u, 2 * s), block_hankel(y, 2 * s)
        columns.append(np.vstack([inputs[s * 2 :], inputs[: s * 2], outputs]))
    stacked = np.hstack(columns)
    factor = triangular_factor(trials, s)
    assert factor.T @ factor == pytest.approx(stacked @ stacked.T, rel=1e-9, abs=1e-6)


def test_a_factor_is_continued() -> None:
    trials = trials_of(120, 150)
    whole, begun = triangular_factor(trials, 4), triangular_factor(trials[:1], 4)
    before = begun.copy()
    continued = triangular_factor(trials[1:], 4, begun)
    assert np.abs(continued) == pytest.approx(np.abs(whole), abs=1e-9)
    assert np.array_equal(begun, before)
