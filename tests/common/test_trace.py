import re

import numpy as np
import pytest

from tis.common.errors import DataError
from tis.common.trace import LOST, MAX_DELAY_NS, MAX_SENT_NS, Trace


def _trace(sent_ns: list[int], delay_ns: list[int]) -> Trace:
    return Trace("walk", np.array(sent_ns, np.int64), np.array(delay_ns, np.int64))


def test_a_trace_may_lie_anywhere_within_its_bounds() -> None:
    trace = _trace([0, 5, 5, MAX_SENT_NS], [LOST, 0, MAX_DELAY_NS, LOST])
    assert trace.label == "walk"
    assert trace.about == {}
    assert len(_trace([0], [LOST]).sent_ns) == 1  # nothing came: a fact, though no scenario's trace


@pytest.mark.parametrize(
    ("sent_ns", "delay_ns", "fault"),
    [
        ([], [], "walk: must have at least one row"),
        ([0, 1], [5], "walk: must have as many delays as send times"),
        ([0, -1], [5, 5], "walk: row 1: sent_ns: must be between 0 and 1000000000000000 (got -1)"),
        ([MAX_SENT_NS + 1], [5], "row 0: sent_ns: must be between"),
        ([0, 7, 6], [5, 5, 5], "walk: row 2: sent_ns: must be at least that of the row before (got 6)"),
        ([0], [-2], "walk: row 0: delay_ns: must be between 0 and 3600000000000, or -1 where lost (got -2)"),
        ([0], [MAX_DELAY_NS + 1], "row 0: delay_ns: must be between"),
    ],
)
def test_what_is_no_trace_is_refused(sent_ns: list[int], delay_ns: list[int], fault: str) -> None:
    with pytest.raises(DataError, match=re.escape(fault)):
        _trace(sent_ns, delay_ns)


def test_faults_come_in_the_order_of_rows_and_only_the_first() -> None:
    with pytest.raises(DataError) as caught:
        _trace([0, *range(1000, 980, -1)], [-5] + [5] * 19 + [-9])
    lines = str(caught.value).split("\n")
    assert lines[0].startswith("walk: row 0: delay_ns")
    assert lines[1].startswith("walk: row 2: sent_ns")
    assert len(lines) == 11
    assert lines[-1] == "walk: ... and 11 more"
