"""What a replay comes to, in words: a difference and a lack are not the same."""

from collections import deque
from pathlib import Path

import pytest
from msgspec import convert

from tests.nodes import a_pose
from tis.common.channels import hand_channels
from tis.common.messages import Header, Pose, encode
from tis.common.node import Arrival, Record
from tis.common.records import TICKS, TickNote
from tis.common.runtime.mcap_log import McapLog
from tis.common.safety_records import STOPS, StopNote
from tis.deploy.logs.read.side_log import check_rows
from tis.deploy.run.recorded import LateArrival, RecordedBus, RecordedClock, RecordedStop, recorded_arrivals
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
    arrivals: deque[Arrival | LateArrival | RecordedStop] = deque(
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


def test_at_equal_instants_an_arrival_comes_before_the_tick_or_after_it_as_the_log_says(tmp_path: Path) -> None:
    """Ticks at 20 and 40 ns; arrivals at 20 ns before and after the first, and at 40 ns before the second."""
    key = hand_channels("left", "PSM2").arm.key("tis")
    tick = (Record(TICKS, at_ns, TickNote(tick=k, due_ns=at_ns, begin_ns=at_ns)) for k, at_ns in enumerate((20, 40)))
    heard = (Record(key, at_ns, encode(a_pose(seq)), Pose, 5, seq) for seq, at_ns in enumerate((20, 20, 40)))
    with McapLog(tmp_path / "patient.mcap", {"side": "patient"}) as log:
        for record in (next(heard), next(tick), next(heard), next(heard), next(tick)):
            log.record(record)
    arrivals = recorded_arrivals(tmp_path / "patient.mcap", "tis", "forward")
    bus, order = RecordedBus(arrivals, RecordedClock([(20, 20), (40, 40)]), lambda _: None), []
    for deadline_ns in (20, 40):
        while (found := bus.wait(deadline_ns)) is not None:
            header = Header.unpack(found.arrival.attachment)
            assert header is not None
            order.append(f"arrival {header.seq}")
        order.append(f"tick {deadline_ns}")
    assert order == ["arrival 0", "tick 20", "arrival 1", "arrival 2", "tick 40"]


@pytest.mark.parametrize("stop", [True, False])
def test_a_stop_in_a_log_of_before_is_read(stop: bool) -> None:
    row = {"at_ns": 5, "stop": stop, "reason": "smoke"}
    check_rows(STOPS, [row])
    assert convert(row, StopNote).leaves_stopped is stop
