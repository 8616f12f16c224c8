"""Three kinds of jitter on the same few packets, worked by hand; they differ."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from tis.common.metrics.delay_variation import (
    inter_packet_delay_variation_ns,
    packet_delay_variation_ns,
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
