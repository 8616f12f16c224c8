import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.draws.grid import row_of_cell, row_of_packet, span_ns


def sent_at(*ms: float) -> Trace:
    sent_ns = np.array([round(one * NS_PER_MS) for one in ms])
    return Trace("made", sent_ns, np.zeros(len(ms), np.int64))


def test_packets_take_the_rows_in_turn() -> None:
    assert row_of_packet(3, np.array([0, 1, 2, 3, 2**32])).tolist() == [0, 1, 2, 0, 1]


def test_a_cell_takes_the_latest_row_sent_by_its_beginning() -> None:
    trace = sent_at(0, 2, 2.5, 6)  # mean distance 2 ms, so it lasts 8 ms
    assert span_ns(trace) == 8_000_000
    assert row_of_cell(trace, np.arange(10)).tolist() == [0, 0, 1, 2, 2, 2, 3, 3, 0, 0]


def test_of_rows_sent_at_once_the_last_one_holds() -> None:
    assert row_of_cell(sent_at(0, 1, 1, 2), np.arange(3)).tolist() == [0, 2, 3]


@pytest.mark.parametrize("trace", [sent_at(0), sent_at(5), sent_at(0, 0)])
def test_a_trace_of_no_length_lasts_1_ms(trace: Trace) -> None:
    assert span_ns(trace) == NS_PER_MS
    assert row_of_cell(trace, np.arange(3)).tolist() == [len(trace.sent_ns) - 1] * 3


@given(st.lists(st.integers(0, 20_000_000), min_size=2, max_size=12).map(sorted), st.integers(0, 2**40))
def test_row_by_row(sent_ns: list[int], cell: int) -> None:
    trace = Trace("made", np.array(sent_ns), np.zeros(len(sent_ns), np.int64))
    t = cell * NS_PER_MS % span_ns(trace)
    want = max(i for i, sent in enumerate(sent_ns) if sent - sent_ns[0] <= t)
    assert row_of_cell(trace, np.array([cell])).tolist() == [want]
