"""Recorded opportunities, against mahimahi's rules applied to one opportunity after the other."""

from fractions import Fraction
from itertools import count

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.netem.link.queue.making import Offered, rate
from tests.netem.making import KEY, link
from tis.common.scenario.network.capacity import RecordedRate
from tis.common.streams import Address
from tis.common.trace import OpportunityTrace
from tis.netem.link.queue.server import Departed, Server
from tis.netem.link.queue.transmission import Opportunities, Service

MS = 1_000_000


def _recording(at_ms: list[int]) -> OpportunityTrace:
    at_ns = np.array(at_ms, np.int64) * MS
    return OpportunityTrace("cell.down", at_ns, np.zeros(len(at_ns), np.int64))


def _server(at_ms: list[int], n_bytes: int = 1500, scale: float = 1.0) -> Server:
    part = RecordedRate(opportunities="cell.down", opportunity_bytes=n_bytes)
    return Server(Service(part, scale), Address(1, "forward", "link"), {"cell.down": _recording(at_ms)})


def _one_by_one(at_ms: list[int], n_bytes: int, arrivals: list[Offered]) -> list[int]:
    """Return when each message leaves: an opportunity serves what came before it, byte by byte, and no more."""
    left: list[int] = []
    sizes = [arrival.n_bytes for arrival in arrivals]
    for number in count():
        round_number, index = divmod(number, len(at_ms))
        now_ns = (round_number * at_ms[-1] + at_ms[index]) * MS
        budget = n_bytes
        while len(left) < len(arrivals) and arrivals[len(left)].at_ns < now_ns:
            taken = min(budget, sizes[len(left)])
            sizes[len(left)] -= taken
            budget -= taken
            if sizes[len(left)]:
                break
            left.append(now_ns)
        if len(left) == len(arrivals):
            return left
    raise AssertionError


_TRACES = st.lists(st.integers(0, 12), min_size=1, max_size=8).map(sorted).filter(lambda at_ms: at_ms[-1] > 0)
_ARRIVALS = st.lists(
    st.tuples(st.one_of(st.integers(0, 9).map(lambda ms: ms * MS), st.integers(0, 20 * MS)), st.integers(1, 4000)),
    min_size=1,
    max_size=20,
)


@given(_TRACES, st.sampled_from([1, 700, 1500]), _ARRIVALS)
def test_departures_are_those_of_the_rules_one_by_one(
    at_ms: list[int], n_bytes: int, steps: list[tuple[int, int]]
) -> None:
    at_ns, arrivals = 0, []
    for gap_ns, size in steps:
        at_ns += gap_ns
        arrivals.append(Offered(at_ns, size if n_bytes > 1 else 1 + size % 9))
    server = _server(at_ms, n_bytes)
    for i, arrival in enumerate(arrivals):
        assert server.offer(i, arrival.n_bytes, arrival.at_ns)
    left = [one.left_ns for one in server.depart(10**18)]
    assert left == _one_by_one(at_ms, n_bytes, arrivals)


def test_a_standing_backlog_leaves_at_the_opportunities_themselves() -> None:
    at_ms = [0, 3, 3, 4, 9, 20]
    made = link(traces={"cell.down": _recording(at_ms)}, forward={"rate": {"opportunities": "cell.down"}})
    for seq in range(30):
        made.offer(KEY, b"", 1500, 0, seq)
    found = []
    while (next_ns := made.next_release_ns()) is not None:
        found += [due.release_ns for due in made.release(next_ns)]
    # what is offered at 0 misses the opportunity at 0, as in mahimahi
    expected = [round_ms + ms for round_ms in range(0, 200, 20) for ms in at_ms][1:31]
    assert found == [ms * MS for ms in expected]


def test_a_factor_scales_the_bytes_of_each_opportunity() -> None:
    server = _server([10], scale=0.5)
    server.offer("whole", 1500, 0)
    assert server.depart(10**18) == [Departed("whole", 0, 20 * MS, False)]


def test_what_is_left_goes_on_at_a_rate_and_back() -> None:
    server = _server([10])
    server.offer("first", 4500, 0)
    # one of three opportunities has passed; 3000 bytes are left, and a byte takes 1 us
    server.set_service(Service(rate(8_000)), 15 * MS)
    assert server.next_departure_ns() == 18 * MS
    recorded = Service(RecordedRate(opportunities="cell.down"))
    server.set_service(recorded, 16 * MS)  # 2000 bytes are left: two opportunities
    assert server.depart(10**18) == [Departed("first", 0, 30 * MS, False)]


@given(_TRACES, st.integers(1, 5000), st.integers(0, 40 * MS))
def test_the_bytes_left_are_those_of_the_opportunities_to_come(at_ms: list[int], n_bytes: int, now_ns: int) -> None:
    recording = _recording(at_ms)
    line = Opportunities(recording.sent_ns, 1500)
    line.send(n_bytes, 0)
    rounds = range(1 + now_ns // (at_ms[-1] * MS))
    used = sum(0 < (r * at_ms[-1] + ms) * MS <= now_ns for r in rounds for ms in at_ms)
    assert line.left(now_ns) == Fraction(max(0, n_bytes - 1500 * used))
