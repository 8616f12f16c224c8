"""Compact columns of integers against plain lists."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.deploy.logs.read.compact_ints import CompactInts

INTS = st.integers(-(2**63), 2**63 - 1)
STEPS = st.sampled_from([0, 1, 300, 70_000, 2**33, 2**50])


@settings(max_examples=25)
@given(st.lists(st.tuples(INTS, STEPS, st.integers(0, 5000)), max_size=5), st.booleans())
def test_what_goes_in_comes_out(runs: list[tuple[int, int, int]], as_arrays: bool) -> None:
    column, expected = CompactInts(), []
    for first, step, n in runs:
        values = [max(min(first + i * step, 2**63 - 1), -(2**63)) for i in range(n)]
        column.extend(np.array(values, dtype=np.int64) if as_arrays else values)
        column.append(first)
        expected += [*values, first]
    assert column.values().tolist() == expected
    assert column.values().dtype == np.int64
    assert len(column) == len(expected)
    for i in range(0, len(expected), 997):
        assert column[i] == expected[i]


def test_what_is_read_is_a_copy() -> None:
    column = CompactInts()
    column.extend(range(10_000))
    column.values()[:] = -1
    assert column.values().tolist() == list(range(10_000))


@pytest.mark.parametrize("value", ["1", None, 2**63])
def test_what_is_no_int64_is_refused(value: object) -> None:
    with pytest.raises((TypeError, OverflowError)):
        CompactInts().extend([value])  # type: ignore[list-item]
