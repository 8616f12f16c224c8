from math import inf

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.netem.stages.loss.making import HERE, make
from tis.common.streams import BLOCK
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS
from tis.netem.draws.grid import span_ns
from tis.netem.stages.loss import ExpectedLoss, expected_loss, loss_blocks


def trace_of(rows: str, sent_ms: list[float] | None = None) -> Trace:
    """x: lost, o: received; one row a ms unless said otherwise."""
    sent_ns = np.array([round(ms * NS_PER_MS) for ms in sent_ms or range(len(rows))])
    return Trace("made", sent_ns, np.array([-1 if row == "x" else 5 for row in rows]))


def pattern(trace: Trace, advance: str, first: int, n: int) -> str:
    blocks = loss_blocks(make("trace", path="t.csv", advance=advance), HERE, {"t.csv": trace})
    number, offset = divmod(first, BLOCK)
    values = np.concatenate([blocks.block(number), blocks.block(number + 1)])[offset : offset + n]
    return "".join("x" if value == 1 else "o" for value in values)


def test_packet_i_takes_row_i_modulo_their_number() -> None:
    trace = trace_of("oxxoo")
    assert pattern(trace, "packet", 0, 12) == "oxxoooxxooox"
    assert pattern(trace, "packet", 5 * 4096, 6) == "oxxooo"
    assert pattern(trace, "packet", 4094, 6) == "ooxxoo"  # 4094 = 4 modulo 5


def test_a_cell_takes_the_row_of_its_time() -> None:
    trace = trace_of("xoxo", [0, 2, 3, 6])  # lasts 8 ms
    assert pattern(trace, "time", 0, 16) == "xxoxxxooxxoxxxoo"
    blocks = loss_blocks(make("trace", path="t.csv", advance="time"), HERE, {"t.csv": trace})
    assert blocks.counts == "cell"


@pytest.mark.parametrize(
    ("rows", "want"),
    [
        ("oxxo", ExpectedLoss(0.5, 2.0)),
        ("xoox", ExpectedLoss(0.5, 2.0)),  # the last row is followed by the first
        ("xoxoo", ExpectedLoss(0.4, 1.0)),
        ("ooo", ExpectedLoss(0.0, 0.0)),
        ("xx", ExpectedLoss(1.0, inf)),
    ],
)
def test_share_and_runs_of_rows(rows: str, want: ExpectedLoss) -> None:
    assert expected_loss(make("trace", path="t.csv"), {"t.csv": trace_of(rows)}) == pytest.approx(want)


def n_cells(trace: Trace) -> int:
    """How many cells a turn of the trace has."""
    return span_ns(trace) // NS_PER_MS


@given(
    rows=st.text("xo", min_size=2, max_size=6),
    gaps=st.lists(st.sampled_from([0, 0.25, 0.5, 1, 2.5]), min_size=6, max_size=6),
)
def test_share_of_run_time_is_that_of_the_cells(rows: str, gaps: list[float]) -> None:
    trace = trace_of(rows, np.cumsum(gaps)[: len(rows)].tolist())
    part = make("trace", path="t.csv", advance="time")
    cells = loss_blocks(part, HERE, {"t.csv": trace}).block(0)
    in_turns = cells[: BLOCK // n_cells(trace) * n_cells(trace)]
    assert expected_loss(part, {"t.csv": trace}).p_loss == pytest.approx(in_turns.mean(), rel=1e-12)
