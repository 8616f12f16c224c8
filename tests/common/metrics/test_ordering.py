import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from common.metrics.ordering import OrderCounts, first_arrivals, is_reordered, order_counts


def seq(*values: int) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)


def rfc_4737(values: list[int]) -> OrderCounts:
    """Run the loop of the RFC's section 3.3, with duplicates taken out as they come."""
    next_expected, seen, reordered, duplicated = 0, set[int](), 0, 0
    for s in values:
        if s in seen:
            duplicated += 1
            continue
        seen.add(s)
        if s >= next_expected:
            next_expected = s + 1
        else:
            reordered += 1
    return OrderCounts(reordered, duplicated)


def test_one_late_packet_is_one_reordered_packet() -> None:
    assert is_reordered(seq(1, 2, 3, 5, 6, 4, 7)).tolist() == [False] * 5 + [True, False]


def test_one_early_packet_makes_all_that_it_overtook_late() -> None:
    assert order_counts({"k": seq(4, 0, 1, 2, 3)}) == OrderCounts(4, 0)


def test_a_gap_reorders_nothing() -> None:
    assert order_counts({"k": seq(0, 1, 7, 8, 100)}) == OrderCounts(0, 0)


def test_a_duplicate_is_no_reordered_packet() -> None:
    assert order_counts({"k": seq(0, 1, 2, 0, 1, 3, 3)}) == OrderCounts(0, 3)
    # 1 comes late, and then once more
    assert order_counts({"k": seq(0, 2, 1, 1)}) == OrderCounts(1, 1)


def test_keys_have_no_order_between_them() -> None:
    assert order_counts({"a": seq(5, 6), "b": seq(0, 1, 0)}) == OrderCounts(0, 1)
    assert order_counts({"empty": seq()}) == OrderCounts(0, 0)


def test_first_arrivals_keep_the_order_of_arrival() -> None:
    assert first_arrivals(seq(3, 1, 3, 2, 1)).tolist() == [3, 1, 2]


@settings(deadline=None, max_examples=100)
@given(st.lists(st.integers(0, 15), max_size=40))
def test_equals_the_loop_of_the_rfc(values: list[int]) -> None:
    assert order_counts({"k": seq(*values)}) == rfc_4737(values)
