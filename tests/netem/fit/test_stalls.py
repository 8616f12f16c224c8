"""Stalls found again in records of numpy alone, and none in records of other processes."""

import numpy as np
import pytest

from tests.netem.fit.synthetic_records import Parameters, record
from tis.common.trace import LOST, Trace
from tis.netem.fit.outages import find_stalls

RATE_HZ = 100


def _stalled(begins_s: np.ndarray, lengths_s: np.ndarray, seconds: float = 300.0, loss: float = 0.0) -> Trace:
    """Return a record of 20 ms and a jitter of 2 ms, in which nothing leaves during the stalls; nothing overtakes."""
    rng = np.random.default_rng(5)
    sent = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
    leaves = sent.copy()
    for begin, length in zip(begins_s, lengths_s, strict=True):
        leaves = np.where((sent >= begin) & (sent < begin + length), begin + length, leaves)
    arrives = np.maximum.accumulate(leaves + 0.020 + 0.002 * rng.random(len(sent)))
    delay_ns = np.rint((arrives - sent) * 1e9).astype(np.int64)
    return Trace(
        "stalled", np.rint(sent * 1e9).astype(np.int64), np.where(rng.random(len(sent)) < loss, LOST, delay_ns)
    )


@pytest.mark.parametrize("loss", [0.0, 0.1])
def test_stalls_are_found_where_they_are_and_with_their_length(loss: float) -> None:
    begins_s = np.array([10.003, 40.5, 77.0, 123.4, 200.0, 260.2])
    lengths_s = np.array([0.2, 0.5, 0.3, 1.0, 0.15, 0.4])
    found = find_stalls(_stalled(begins_s, lengths_s, loss=loss))
    assert found is not None
    assert found.begins_s == pytest.approx(begins_s, abs=0.035)  # the first messages of a stall may be lost
    assert found.begins_s + found.lengths_s == pytest.approx(begins_s + lengths_s, abs=0.005)
    assert found.process["effect"] == "stall"


def test_what_is_left_without_the_stalls_is_the_usual_delay() -> None:
    trace = _stalled(np.arange(7.0, 290.0, 15.0), np.full(19, 0.3))
    found = find_stalls(trace)
    assert found is not None
    assert found.process["kind"] == "periodic"
    assert found.process["every_s"] == pytest.approx(15, abs=0.01)
    assert found.process["for_s"] == pytest.approx(0.3, abs=0.01)
    assert found.process["first_s"] == pytest.approx(7, abs=0.02)
    rest_ms = found.removed_from(trace).delay_ns / 1e6
    assert rest_ms.min() >= 18
    assert rest_ms.max() <= 24
    assert np.count_nonzero(found.wait_ns) == pytest.approx(19 * 30, abs=19)


def test_gaps_behind_which_nothing_waits_are_no_stalls() -> None:
    trace = _stalled(np.empty(0), np.empty(0))
    delay_ns = trace.delay_ns.copy()
    for first in range(1000, 29_000, 3000):
        delay_ns[first : first + 100] = LOST
    assert find_stalls(Trace("lost", trace.sent_ns, delay_ns)) is None
    assert find_stalls(trace) is None


@pytest.mark.parametrize("name", ["bursts", "outages"])
def test_correlated_delays_and_outages_have_no_stalls(name: str) -> None:
    assert find_stalls(record(name, Parameters(), 3)) is None


def test_three_stalls_are_too_few_to_tell_a_process() -> None:
    assert find_stalls(_stalled(np.array([50.0, 100.0, 200.0]), np.full(3, 0.3))) is None
    assert find_stalls(Trace("one", np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64))) is None
