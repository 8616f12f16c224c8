"""What measuring adds: by the header, by the record's digits, and spreads by literals."""

import numpy as np
import pytest

from tis.common.errors import DataError
from tis.common.trace import LOST, Trace
from tis.netem.fit.direction import steady_reason
from tis.netem.fit.record import MEASURING_ADDS, NOTHING_ADDED, Spread, measuring_adds

US, MS = 1_000, 1_000_000


def trace(delay_ns: list[int], said: str | None = None) -> Trace:
    about = {} if said is None else {MEASURING_ADDS: said}
    return Trace("t.csv", np.arange(len(delay_ns), dtype=np.int64), np.array(delay_ns, dtype=np.int64), about)


def test_spreads_by_hand() -> None:
    """0 .. 1000 ms in steps of 1: the quantile p lies at 1000 p exactly."""
    assert Spread.of(np.arange(1001) * MS) == (900 * MS, 980 * MS, 1000 * MS)


def test_all_three_must_be_within() -> None:
    assert Spread(1, 2, 3).within(Spread(1, 2, 3))
    assert not any(Spread(*one).within(Spread(1, 2, 3)) for one in ((2, 2, 3), (1, 3, 3), (1, 2, 4)))


@pytest.mark.parametrize(
    ("delay_ns", "step_ns"),
    [
        ([25_100_000, LOST, 25_200_000], 100 * US),
        ([25_123_000, 25_200_000], US),
        ([25_123_456], US),
        ([3 * MS, 4 * MS], MS),
        ([20 * MS, 30 * MS], MS),
        ([LOST], MS),
    ],
)
def test_digits_tell_no_less_than_their_step(delay_ns: list[int], step_ns: int) -> None:
    assert measuring_adds(trace(delay_ns)) == (step_ns,) * 3


def test_the_header_says_what_an_idle_relay_adds_and_a_path_may_have_more() -> None:
    one = Spread(40 * US, 100 * US, 5 * MS)
    adds = measuring_adds(trace([25_123_456], one.words))
    margin = adds.most_ns / one.most_ns
    assert margin > 1
    assert adds[:2] == (margin * one.most_ns, margin * one.all_ns)


def test_coarse_digits_count_beside_the_header() -> None:
    assert measuring_adds(trace([3 * MS], "0.01 (p95 - p5), 0.02 (max - min)"))[:2] == (MS, MS)


@pytest.mark.parametrize("said", ["", "0.1", "-1 (p95 - p5), 2 (max - min)", "nan (p95 - p5), 2 (max - min)"])
def test_a_header_that_says_something_else_is_refused(said: str) -> None:
    with pytest.raises(DataError, match=r"t\.csv: measuring_adds_ms: must be like"):
        measuring_adds(trace([MS], said))


def test_why_a_delay_is_steady_is_said_with_figures() -> None:
    assert steady_reason(np.full(50, 25 * MS), NOTHING_ADDED) == "all delays are equal"
    delay_ns = np.linspace(10 * MS, 10 * MS + 100 * US, 1001).astype(np.int64)
    said = "varies by 0.09 ms (p95 - p5), no more than the 0.1 ms that measuring may add"
    adds = Spread(100 * US, 200 * US, np.inf)
    assert steady_reason(delay_ns, adds) == said
    delay_ns[3] = 17 * MS
    assert steady_reason(delay_ns, adds) == f"{said}; 1 of 1001 came up to 6.95 ms later, as after stalls"
    assert steady_reason(delay_ns, adds._replace(all_ns=MS)) == ""
    assert steady_reason(delay_ns, adds._replace(most_ns=80 * US)) == ""
    assert steady_reason(delay_ns, NOTHING_ADDED) == ""
