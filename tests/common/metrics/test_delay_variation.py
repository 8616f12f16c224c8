"""Three kinds of jitter on the same few packets, worked by hand; they differ."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tis.common.metrics.delay_variation import (
    first_arrivals,
    inter_packet_delay_variation_ns,
    is_reordered,
    n_reordering,
    packet_delay_variation_ns,
    reordering_extents,
    rtp_jitter_ns,
)

MS = 1_000_000
# six packets sent every 10 ms; the fourth is lost; the last arrives first of the last two
DELAY_MS = [5, 8, 6, 0, 20, 7]
ARRIVED = [True, True, True, False, True, True]


def _ns(values_ms: list[int]) -> NDArray[np.int64]:
    return np.array(values_ms, dtype=np.int64) * MS


def test_pdv_is_what_is_above_the_smallest_delay() -> None:
    delay_ns = _ns(DELAY_MS)[np.array(ARRIVED)]
    assert (packet_delay_variation_ns(delay_ns) // MS).tolist() == [0, 3, 1, 15, 2]


def test_ipdv_goes_by_the_order_of_sending_and_stops_at_a_loss() -> None:
    """Pairs (0, 1), (1, 2), (4, 5); the two with the lost one have none."""
    variation_ns = inter_packet_delay_variation_ns(_ns(DELAY_MS), np.array(ARRIVED))
    assert (variation_ns // MS).tolist() == [3, -2, -13]


def test_rtp_jitter_goes_by_the_order_of_arrival() -> None:
    """Arrivals at 5, 18, 26, 57 (the last), 60: |D| = 3, 2, 1, 13; J = 3/16, ... by the RFC's loop."""
    sent_ns, arrived_ns = _ns([0, 10, 20, 50, 40]), _ns([5, 18, 26, 57, 60])
    expected = [3 / 16]
    for change in (2, 1, 13):
        expected.append(expected[-1] + (change - expected[-1]) / 16)
    assert rtp_jitter_ns(sent_ns, arrived_ns) / MS == pytest.approx(expected, rel=1e-12)


def test_of_nothing_and_of_one_packet_nothing_varies() -> None:
    none, one = _ns([]), _ns([3])
    assert len(packet_delay_variation_ns(none)) == 0
    assert packet_delay_variation_ns(one).tolist() == [0]
    assert len(inter_packet_delay_variation_ns(one, np.array([True]))) == 0
    assert len(inter_packet_delay_variation_ns(none, np.empty(0, dtype=bool))) == 0
    assert len(rtp_jitter_ns(none, none)) == len(rtp_jitter_ns(one, one)) == 0


@settings(deadline=None, max_examples=30)
@given(st.integers(2, 1100), st.integers(0, 2**32))
def test_rtp_jitter_is_the_loop_of_the_rfc(n: int, seed: int) -> None:
    random = np.random.default_rng(seed)
    sent_ns = np.arange(n, dtype=np.int64) * MS
    arrived_ns = sent_ns + random.integers(0, 40 * MS, n)
    jitter, loop = 0.0, []
    transit = arrived_ns - sent_ns
    for before, now in zip(transit[:-1].tolist(), transit[1:].tolist(), strict=True):
        jitter += (abs(now - before) - jitter) / 16
        loop.append(jitter)
    assert rtp_jitter_ns(sent_ns, arrived_ns) == pytest.approx(loop, rel=1e-9)


def seq(*values: int) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)


def rfc_4737(values: list[int]) -> int:
    """Run the loop of the RFC's section 3.3, with duplicates taken out as they come."""
    next_expected, seen, reordered = 0, set[int](), 0
    for s in values:
        if s in seen:
            continue
        seen.add(s)
        if s >= next_expected:
            next_expected = s + 1
        else:
            reordered += 1
    return reordered


def n_reordered(*values: int) -> int:
    return int(is_reordered(first_arrivals(seq(*values))).sum())


def test_one_late_packet_is_one_reordered_packet() -> None:
    assert is_reordered(seq(1, 2, 3, 5, 6, 4, 7)).tolist() == [False] * 5 + [True, False]


def test_one_early_packet_makes_all_that_it_overtook_late() -> None:
    assert n_reordered(4, 0, 1, 2, 3) == 4


def test_a_gap_reorders_nothing() -> None:
    assert n_reordered(0, 1, 7, 8, 100) == 0
    assert n_reordered() == 0


def test_a_duplicate_is_no_reordered_packet() -> None:
    assert n_reordered(0, 1, 2, 0, 1, 3, 3) == 0
    assert n_reordered(0, 2, 1, 1) == 1  # 1 comes late, and then once more


def test_first_arrivals_keep_the_order_of_arrival() -> None:
    assert first_arrivals(seq(3, 1, 3, 2, 1)).tolist() == [3, 1, 2]


@settings(deadline=None, max_examples=100)
@given(st.lists(st.integers(0, 15), max_size=40))
def test_equals_the_loop_of_the_rfc(values: list[int]) -> None:
    assert n_reordered(*values) == rfc_4737(values)


def test_the_extent_is_how_far_back_the_first_later_packet_lies() -> None:
    """4 comes at place 5; the first larger number, 5, came at place 3. And 1 at place 4 after 2 at place 0."""
    assert reordering_extents(seq(1, 2, 3, 5, 6, 4, 7)).tolist() == [2]
    assert reordering_extents(seq(2, 3, 4, 5, 1, 0)).tolist() == [4, 5]
    assert reordering_extents(seq(0, 1, 9)).tolist() == reordering_extents(seq()).tolist() == []


@settings(deadline=None, max_examples=100)
@given(st.lists(st.integers(0, 60), unique=True, max_size=40))
def test_extents_are_those_of_the_rfc(values: list[int]) -> None:
    expected = []
    for i, s in enumerate(values):
        earlier = [j for j in range(i) if values[j] > s]
        if earlier:
            expected.append(i - earlier[0])
    assert reordering_extents(seq(*values)).tolist() == expected


@settings(deadline=None, max_examples=50)
@given(st.permutations(range(9)))
def test_n_reordering_is_the_rfcs_definition(order: list[int]) -> None:
    expected = []
    for i, number in enumerate(order):
        if any(before > number for before in order[:i]):
            n = 0
            while n < i and order[i - n - 1] > number:
                n += 1
            expected.append(n)
    assert n_reordering(np.array(order, dtype=np.int64)).tolist() == expected


def test_of_packets_late_together_the_first_has_all_larger_ones_before_it() -> None:
    assert n_reordering(np.array([1, 2, 3, 7, 8, 9, 10, 4, 5, 6, 11])).tolist() == [4, 0, 0]
