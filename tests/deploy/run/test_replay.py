"""What a replay comes to, in words: a difference and a lack are not the same."""

from collections import deque

import pytest
from msgspec import convert

from tis.common.node import Arrival
from tis.common.safety_records import STOPS, StopNote
from tis.deploy.logs.read.side_log import check_rows
from tis.deploy.run.recorded import RecordedBus, RecordedClock, RecordedStop
from tis.deploy.run.replay import Comparison

_PART = "the readable part is identical, bit for bit, but the log does not hold the whole run"


@pytest.mark.parametrize(
    ("found", "words", "identical"),
    [
        (Comparison(10, 0, 0), "identical, bit for bit", True),
        (Comparison(10, 1, 0), "not identical", False),
        (Comparison(10, 1, 0, largest=2e-13), "equal but for rounding, by 2.0e-13 at most", False),
        (Comparison(10, 1, 0, largest=2e-9), "not identical", False),
        (Comparison(10, 1, 1, largest=2e-13), "not identical", False),
        (Comparison(10, 0, 1), "not identical", False),
        (Comparison(10, 0, 0, "torn"), _PART, False),
        (Comparison(10, 0, 3, "torn"), _PART, False),
        (Comparison(10, 2, 0, "torn"), "not identical", False),
        (Comparison(0, 0, 0), "nothing to compare", False),
    ],
)
def test_each_outcome_has_its_words(found: Comparison, words: str, identical: bool) -> None:
    assert str(found).endswith(f"are in one only: {words}")
    assert found.identical is identical


def test_recorded_stops_act_in_the_order_of_the_arrivals() -> None:
    """A stop at 10 ns acts before the tick at 20 ns, one at 30 ns after the arrival at 25 ns."""
    told: list[bool] = []
    arrivals: deque[Arrival | RecordedStop] = deque(
        [RecordedStop(10, True), Arrival("east", "k", b"", b"", 25), RecordedStop(30, False)]
    )
    bus = RecordedBus(arrivals, RecordedClock([(20, 20), (40, 40)]), told.append)
    assert bus.wait(20) is None
    assert told == [True]
    found = bus.wait(40)
    assert found is not None
    assert (found.arrival.recv_ns, told) == (25, [True])
    assert bus.wait(40) is None
    assert told == [True, False]


@pytest.mark.parametrize("stop", [True, False])
def test_a_stop_in_a_log_of_before_is_read(stop: bool) -> None:
    row = {"at_ns": 5, "stop": stop, "reason": "smoke"}
    check_rows(STOPS, [row])
    assert convert(row, StopNote).leaves_stopped is stop
