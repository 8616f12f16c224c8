"""Packets paired by sequence number, with literal instants."""

from hypothesis import given, settings
from hypothesis import strategies as st

from tis.deploy.watch.streams import Crossing, Crossings

MS = 1_000_000
S = 1000 * MS


def test_a_packets_delay_is_the_difference_of_its_two_sightings() -> None:
    crossings = Crossings()
    assert crossings.offered(7, sent_ns=90 * MS, at_ns=1000 * MS) is None
    assert crossings.arrived(7, 1040 * MS) == Crossing(90 * MS, 40 * MS)


def test_the_two_networks_may_be_heard_in_either_order_and_no_delay_is_negative() -> None:
    crossings = Crossings()
    assert crossings.arrived(7, 1000 * MS) is None
    assert crossings.offered(7, sent_ns=90 * MS, at_ns=1001 * MS) == Crossing(90 * MS, 0)


def test_a_copy_and_a_packet_from_before_tell_nothing() -> None:
    crossings = Crossings()
    crossings.offered(1, 0, 0)
    assert crossings.arrived(1, 5 * MS) == Crossing(0, 5 * MS)
    assert crossings.arrived(1, 6 * MS) is None
    assert crossings.arrived(99, 6 * MS) is None
    assert crossings.expire(20 * S) == []


def test_a_packet_is_lost_half_a_second_later_if_one_after_it_came_and_is_reported_again_when_it_arrives() -> None:
    crossings = Crossings()
    crossings.offered(1, 10 * MS, 0)
    crossings.offered(2, 11 * MS, MS)
    crossings.arrived(2, 40 * MS)
    assert crossings.expire(499 * MS) == []
    assert crossings.undecided_ns == 10 * MS
    assert crossings.expire(500 * MS) == [Crossing(10 * MS, None)]
    assert crossings.expire(900 * MS) == []
    assert crossings.undecided_ns is None
    assert crossings.arrived(1, 2 * S) == Crossing(10 * MS, 2 * S)


def test_what_a_busy_emulator_still_holds_is_not_lost_before_2_s() -> None:
    """200 packets a second, of which all after the first come 0.9 s late, in order."""
    crossings, lost = Crossings(), []
    for ms in range(0, 5000, 5):
        crossings.offered(ms, ms * MS, ms * MS)
        if ms >= 900:
            crossings.arrived(ms - 900, ms * MS)
        lost += crossings.expire(ms * MS)
    assert lost == []
    assert crossings.expire(5895 * MS) == []
    assert len(crossings.expire(20 * S)) == 180  # nothing came any more


def test_what_was_sent_before_anybody_listened_at_the_other_end_is_not_lost() -> None:
    crossings = Crossings()
    for seq in range(4):
        crossings.offered(seq, seq, seq * MS)
    assert crossings.expire(20 * S, heard_ns=3 * MS) == [Crossing(3, None)]
    assert crossings.expire(30 * S) == []


def test_patience_grows_with_the_delays_up_to_5_s() -> None:
    crossings = Crossings()
    crossings.offered(1, 0, 0)
    crossings.arrived(1, 600 * MS)
    assert crossings.loss_timeout_ns == 2 * 600 * MS + 300 * MS
    crossings.offered(2, 0, 0)
    crossings.arrived(2, 4 * S)
    assert crossings.loss_timeout_ns == 5 * S


def test_what_will_not_be_looked_for_is_not_counted_as_lost() -> None:
    crossings = Crossings()
    for seq in range(6):
        crossings.offered(seq, seq, 0)
    crossings.keep_multiples(4)
    assert crossings.expire(2 * S) == [Crossing(0, None), Crossing(4, None)]


@settings(max_examples=50)
@given(fates=st.lists(st.one_of(st.none(), st.integers(0, 400)), max_size=40))
def test_every_packet_is_told_exactly_once(fates: list[int | None]) -> None:
    """A delay in ms, or None for lost; packets are 10 ms apart, and what arrives is heard in the order of arrival."""
    crossings = Crossings()
    events = [(10 * i, 0, i) for i in range(len(fates))]
    events += [(10 * i + delay, 1, i) for i, delay in enumerate(fates) if delay is not None]
    told: list[Crossing] = []
    for at_ms, kind, i in sorted(events):
        found = crossings.arrived(i, at_ms * MS) if kind else crossings.offered(i, i, at_ms * MS)
        told += [found] if found is not None else []
        told += crossings.expire(at_ms * MS)
    told += crossings.expire(100 * S)
    expected = [Crossing(i, None if delay is None else delay * MS) for i, delay in enumerate(fates)]
    assert sorted(told, key=lambda row: row.sent_ns) == expected
