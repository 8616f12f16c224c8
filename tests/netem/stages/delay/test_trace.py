import itertools
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.netem.stages.delay.laws import ADDRESS
from tis.common.scenario.network.pipeline import Stages
from tis.common.streams import BLOCK
from tis.common.trace import Trace
from tis.netem.stages.delay import delay_blocks, latency_of
from tis.netem.stages.delay.trace import row_delays_ns

PATH = "walk.csv"
NS = 1_000_000


def _trace(*rows: tuple[float, float | None]) -> Trace:
    sent_ns = np.array([round(sent_ms * NS) for sent_ms, _ in rows])
    return Trace(PATH, sent_ns, np.array([-1 if d is None else round(d * NS) for _, d in rows]))


FOUR = _trace((0, 10), (1, None), (2, 30), (5, 10))


def _stages(advance: str, **others: Any) -> Stages:
    return Stages.model_validate({"delay": {"kind": "trace", "path": PATH, "advance": advance}, **others})


def _block(advance: str, trace: Trace, number: int = 0, **others: Any) -> list[float]:
    blocks = delay_blocks(_stages(advance, **others), ADDRESS, {PATH: trace})
    assert blocks.counts == ("packet" if advance == "packet" else "cell")
    return [float(delay_ms) for delay_ms in blocks.block(number) / NS]


def test_each_packet_takes_the_next_row_and_a_lost_row_repeats_the_one_before() -> None:
    rows = itertools.cycle([10, 10, 30, 10])
    expected = [next(rows) for _ in range(2 * BLOCK)]
    assert _block("packet", FOUR) == expected[:BLOCK]
    assert _block("packet", FOUR, 1) == expected[BLOCK:]


def test_a_trace_of_three_rows_does_not_begin_anew_with_each_block() -> None:
    trace = _trace((0, 1), (1, 2), (2, 3))
    assert _block("packet", trace, 1)[:4] == [(BLOCK + k) % 3 + 1 for k in range(4)]


def test_each_cell_takes_the_row_sent_last() -> None:
    # 4 rows over 5 ms: the last one holds for the mean gap of 5/3 ms, which makes 6.67 ms, on the grid 7
    assert _block("time", FOUR)[:15] == [10, 10, 30, 30, 30, 10, 10] * 2 + [10]
    assert _block("time", FOUR, 1)[:7] == [[10, 10, 30, 30, 30, 10, 10][(BLOCK + k) % 7] for k in range(7)]


def test_a_trace_that_begins_with_a_loss_takes_its_last_delay() -> None:
    assert row_delays_ns(_trace((0, None), (1, 4), (2, None), (3, 7))).tolist() == [7e6, 4e6, 4e6, 7e6]


@given(st.lists(st.one_of(st.none(), st.integers(0, 50)), min_size=1, max_size=30).filter(lambda d: any(d)))
def test_lost_rows_take_the_delay_that_a_loop_finds(delays: list[float | None]) -> None:
    expected = []
    for row in range(len(delays)):
        back = row
        while delays[back] is None:
            back = (back - 1) % len(delays)
        expected.append(delays[back])
    assert (row_delays_ns(_trace(*enumerate(delays))) / NS).tolist() == expected


def test_jitter_is_added_to_the_rows() -> None:
    with_jitter = _block("packet", FOUR, jitter={"kind": "uniform", "half_width_ms": 2})
    deviation = np.array(with_jitter) - np.array(_block("packet", FOUR))
    assert -2 <= deviation.min() < -1.9
    assert 1.9 < deviation.max() <= 2


def test_a_correlation_beside_a_trace_is_not_heeded() -> None:
    # a change may put a trace in the place of a pipeline's delay and leave its correlation there
    assert _block("packet", FOUR, correlation={"half_life_s": 1}) == _block("packet", FOUR)


@pytest.mark.parametrize("advance", ["packet", "time"])
@pytest.mark.parametrize("lossy", [False, True])
@pytest.mark.parametrize("jitter", [None, {"kind": "uniform", "half_width_ms": 12}])
def test_what_is_asked_for_is_what_comes(advance: str, lossy: bool, jitter: Any) -> None:
    trace = _trace((0, 5), (1.5, 60), (2.25, None), (4, 20), (4, 35), (6, None), (7.75, 8), (9, 20))
    others: dict[str, Any] = {} if jitter is None else {"jitter": jitter}
    if lossy:
        others["loss"] = {"kind": "trace", "path": PATH, "advance": advance}
    asked = latency_of(_stages(advance, **others), {PATH: trace})
    n_blocks = 1 if jitter is None and advance == "packet" else 50
    delay_ms = np.concatenate([_block(advance, trace, number, **others) for number in range(n_blocks)])
    if lossy:
        index = np.arange(len(delay_ms))
        row = index % 8
        if advance == "time":  # 8 rows over 9 ms: 10.29 ms, on the grid 11
            row = np.searchsorted(trace.sent_ns, index % 11 * NS, side="right") - 1
        delay_ms = delay_ms[trace.delay_ns[row] >= 0]
    tolerance = 1e-3 if jitter is None else 7e-3
    assert asked.mean_ns / NS == pytest.approx(delay_ms.mean(), rel=tolerance)
    assert asked.std_ns / NS == pytest.approx(delay_ms.std(), rel=tolerance)
    for p in (0.1, 0.5, 0.9):
        (quantile_ns,) = asked.quantiles_ns([p])
        below = (delay_ms < quantile_ns / NS - 1e-6).mean(), (delay_ms <= quantile_ns / NS + 1e-6).mean()
        assert below[0] - 4e-3 <= p <= below[1] + 4e-3


def test_losses_from_elsewhere_leave_the_rows_that_the_trace_lost() -> None:
    of_another = {"kind": "trace", "path": "other.csv"}
    in_time = {"kind": "trace", "path": PATH, "advance": "time"}
    for loss in (of_another, in_time, {"kind": "bernoulli", "p_loss": 0.5}):
        assert latency_of(_stages("packet", loss=loss), {PATH: FOUR}).mean_ns == 15e6
    same = {"kind": "trace", "path": PATH}
    assert latency_of(_stages("packet", loss=same), {PATH: FOUR}).mean_ns == pytest.approx(50e6 / 3)


def test_a_row_that_no_cell_meets_is_not_asked_for() -> None:
    asked = latency_of(_stages("time"), {PATH: _trace((0, 5), (1.25, 60), (1.75, 7), (3, 5))})
    # the span is 4 ms: cells begin at 0, 1, 2 and 3 ms of it: 60 ms never holds
    assert asked.quantiles_ns([0.01, 0.74, 0.76, 0.99]) == [5e6, 5e6, 7e6, 7e6]
    assert asked.mean_ns == 5.5e6


def test_a_trace_that_nothing_comes_through_still_has_a_delay() -> None:
    trace = _trace((0, None), (1.25, 60), (1.75, None), (3, None))
    loss = {"kind": "trace", "path": PATH, "advance": "time"}
    assert latency_of(_stages("time", loss=loss), {PATH: trace}).mean_ns == 60e6
    assert latency_of(_stages("packet"), {PATH: _trace((0, None), (1, None))}).mean_ns == 0
