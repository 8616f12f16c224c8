"""The books of a link: what crossed at once stands among what was held, in the order of time."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.records import Departure, FateBatch, ReleaseBatch
from tis.common.units import NS_PER_S
from tis.netem.link.ledger import Ledger, when_late
from tis.netem.link.packet import Fate, Flow, Packet
from tis.netem.stages.ordering import Ordering

MS = 1_000_000


def gone(seq: int, offered_ns: int, release_ns: int, queued_ns: int, departure: Departure) -> Packet:
    packet = Packet(Flow("a", None, ""), None, seq, 0, offered_ns, 0, 1, 1, 0, False, seq, Ordering())
    packet.release_ns, packet.queued_ns, packet.departure = release_ns, queued_ns, departure
    return packet


@settings(max_examples=30)
@given(st.lists(st.booleans(), min_size=1, max_size=30))
def test_crossings_stand_between_those_that_were_held(crosses: list[bool]) -> None:
    """Each is offered 10 ms after the one before; those held leave 4 ms later."""
    ledger = Ledger("forward")
    for k, at_once in enumerate(crosses):
        now_ns = 10 * k * MS
        if at_once:
            ledger.crossed("a", k, False, now_ns, now_ns, 100)
        else:
            left_ns = now_ns + 4 * MS
            ledger.decided("a", Fate(k, "deliver", 4 * MS, left_ns), now_ns, 100)
            ledger.left(gone(k, now_ns, left_ns, 0, "released"), left_ns)
    fates, releases = (record.data for record in ledger.close(0)())
    assert isinstance(fates, FateBatch)
    assert isinstance(releases, ReleaseBatch)
    assert fates.seq == releases.seq == tuple(range(len(crosses)))
    assert list(releases.released_ns) == sorted(releases.released_ns)


def test_what_was_dropped_after_all_stands_where_it_was_to_leave() -> None:
    ledger = Ledger("forward")
    ways: tuple[tuple[Departure, int], ...] = (("codel", 30), ("late", 0), ("released", 0))
    for seq, (departure, queued_ns) in enumerate(ways):
        ledger.decided("a", Fate(seq, "deliver"), 10 * seq, 1)
        ledger.left(gone(seq, 10 * seq, 0 if queued_ns else 40 + seq, queued_ns, departure), 50)
    ledger.crossed("a", 3, False, 35, 35, 1)
    releases = ledger.close(0)()[1].data
    assert isinstance(releases, ReleaseBatch)
    assert list(zip(releases.seq, releases.departure, strict=True)) == [
        (0, "codel"), (3, "released"), (1, "late"), (2, "released"),
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("span_s", "newest_s", "clause"),
    [
        ((0.3, 1.2, 0.4), 20, "all late ones left in the first 1.20 s, the worst at 0.40 s: a stall at the start"),
        ((0.3, 1.2, 0.4), 2, "late ones left from 0.30 s to 1.20 s, the worst at 0.40 s"),  # most of a short run
        ((0.3, 19.0, 0.4), 20, "late ones left from 0.30 s to 19.00 s, the worst at 0.40 s"),
    ],
)
def test_a_stall_at_the_start_is_told_from_lateness_all_along(
    span_s: tuple[float, float, float], newest_s: int, clause: str
) -> None:
    first_ns, last_ns, most_ns = (round(one * NS_PER_S) for one in span_s)
    assert when_late(first_ns, last_ns, most_ns, newest_s * NS_PER_S) == clause
