"""Repeats of lost packets: literal instants, properties, and a simulation of a TCP sender by another method."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.netem.stages.loss.recovery import Connection, Terms

MS = 1_000_000
RTT, RTO = 20, 200
TERMS = Terms(RTT * MS, RTT * MS // 2, RTO * MS, 120_000 * MS, True, "none")
END_NS = 10**15


class Offer(NamedTuple):
    """A packet, sent ``at_ms``; its first ``n_lost`` sendings are lost."""

    at_ms: float
    n_lost: int = 0
    delay_ms: float = 10
    n_bytes: int = 256


def due_ms(offers: Sequence[Offer], terms: Terms = TERMS) -> list[float]:
    """Return when each packet is due, driven as a link does it."""
    ways = Connection(lambda item, n, at_ns: None if n < offers[item].n_lost else at_ns)
    found = [-1] * len(offers)
    order: list[int] = []

    def arrive(until_ns: int) -> None:
        for item, from_ns, due_ns in ways.advance(until_ns):
            assert from_ns == round(offers[item].at_ms * MS)
            found[item] = due_ns
            order.append(item)

    def wake(until_ns: int) -> None:
        while (next_ns := ways.next_ns()) is not None and next_ns <= until_ns:
            arrive(next_ns)

    for item, one in enumerate(offers):
        now_ns = round(one.at_ms * MS)
        wake(now_ns)
        arrive(now_ns)
        due = ways.send(item, now_ns, round(one.delay_ms * MS), one.n_bytes, one.n_lost > 0, terms)
        if due is not None:
            found[item] = due
            order.append(item)
    wake(END_NS)
    assert order == list(range(len(offers)))
    return [ns / MS for ns in found]


def test_a_lone_packet_waits_for_the_timeout_which_doubles() -> None:
    assert due_ms([Offer(0, 1)]) == [220 + 10]
    assert due_ms([Offer(0, 3)]) == [220 + 440 + 880 + 10]
    assert due_ms([Offer(0, 3)], TERMS._replace(max_rto_ns=300 * MS)) == [220 + 300 + 300 + 10]


def test_a_packet_a_tenth_of_a_second_later_tells_of_the_loss() -> None:
    """Its acknowledgement comes at 120; the loss is older than a round trip and a quarter."""
    assert due_ms([Offer(0, 1), Offer(100), Offer(200)]) == [130, 130, 210]


def test_the_third_later_acknowledgement_tells_before_rack_is_patient_enough() -> None:
    assert due_ms([Offer(0, 1), *(Offer(ms) for ms in range(1, 40))])[0] == 3 + RTT + 10


def test_two_later_packets_leave_it_to_rack_after_a_quarter_of_a_round_trip() -> None:
    assert due_ms([Offer(0, 1), Offer(1), Offer(2)])[0] == RTT + RTT / 4 + 10


def test_a_repeat_that_is_lost_is_found_by_the_first_packet_sent_after_it() -> None:
    """The first repeat leaves at 23, as does a packet, which is acknowledged at 43."""
    assert due_ms([Offer(0, 2), *(Offer(ms) for ms in range(1, 60))])[0] == 43 + 10


def test_what_follows_waits_and_leaves_together() -> None:
    found = due_ms([Offer(ms, int(ms == 5)) for ms in range(60)])
    assert found[:5] == [10, 11, 12, 13, 14]
    assert found[5:29] == [38] * 24  # 5 + 3 + 20 + 10
    assert found[29:] == [ms + 10 for ms in range(29, 60)]


def test_a_tail_of_two_is_probed_after_two_round_trips() -> None:
    """The last is repeated at 1 + 40 + 8; its acknowledgement at 69 tells of the other."""
    assert due_ms([Offer(0, 1), Offer(1, 1)]) == [69 + 10, 69 + 10]
    assert due_ms([Offer(0, 1), Offer(1, 1)], TERMS._replace(tail_probe=False)) == [230, 250]


def test_after_a_timeout_packets_leave_as_acknowledgements_come() -> None:
    """All of 12 are lost: the first at the timeout, then two segments for each acknowledgement."""
    offers = [Offer(ms, 1, n_bytes=1448) for ms in range(12)]
    found = due_ms(offers, TERMS._replace(tail_probe=False))
    assert found == [230, *[250] * 2, *[270] * 4, *[290] * 5]


def test_what_is_offered_after_a_timeout_is_sent_with_the_acknowledgement() -> None:
    assert due_ms([Offer(0, 1), Offer(225), Offer(300)]) == [230, 250, 310]


offers = st.lists(
    st.tuples(st.integers(0, 300), st.sampled_from([0, 0, 0, 1, 1, 2, 4]), st.integers(0, 30), st.integers(1, 3000)),
    min_size=1,
    max_size=60,
)


def _offers(drawn: list[tuple[int, int, int, int]]) -> list[Offer]:
    at_ms, found = 0, []
    for gap_ms, n_lost, delay_ms, n_bytes in drawn:
        at_ms += gap_ms
        found.append(Offer(at_ms, n_lost, delay_ms, n_bytes))
    return found


@settings(deadline=None, max_examples=150)
@given(offers, st.booleans(), st.sampled_from([1, 30, 200]))
def test_nothing_is_lost_nothing_is_early_and_nothing_overtakes_a_repeat(
    drawn: list[tuple[int, int, int, int]], tail_probe: bool, rto_ms: int
) -> None:
    made = _offers(drawn)
    found = due_ms(made, TERMS._replace(tail_probe=tail_probe, rto_ns=rto_ms * MS))
    latest = 0.0
    for one, due in zip(made, found, strict=True):
        assert due >= max(one.at_ms + one.delay_ms, latest)
        if one.n_lost:
            latest = due


@settings(deadline=None, max_examples=60)
@given(offers)
def test_without_loss_each_packet_has_its_own_delay(drawn: list[tuple[int, int, int, int]]) -> None:
    made = [one._replace(n_lost=0) for one in _offers(drawn)]
    assert due_ms(made) == [one.at_ms + one.delay_ms for one in made]


class Segment:
    """What the other sender knows of a packet."""

    def __init__(self, at_ms: int) -> None:
        self.sent_ms, self.n_sent, self.acked, self.got_ms = at_ms, 0, False, -1


def ticked_ms(gap_ms: int, lost: np.ndarray, n_ticks: int) -> list[int]:
    """Return when a sender in steps of 1 ms, which scans its whole scoreboard, delivers packets each ``gap_ms``.

    ``lost`` (packets, sendings). RACK, three acknowledgements and a timeout of the first, as the RFCs tell; a packet
    each ``gap_ms`` never leaves a tail.
    """
    sent: list[Segment] = []
    acks: dict[int, list[tuple[int, int]]] = {}
    recovers_upto, timer_ms = -1, 0

    def send(i: int, now: int) -> None:
        one = sent[i]
        if not lost[i, one.n_sent]:
            one.got_ms = one.got_ms if one.got_ms >= 0 else now + RTT // 2
            acks.setdefault(now + RTT, []).append((i, now))
        one.sent_ms, one.n_sent = now, one.n_sent + 1

    for now in range(n_ticks):
        for i, at in acks.pop(now, []):
            first = next((k for k, one in enumerate(sent) if not one.acked), len(sent))
            sent[i].acked = True
            timer_ms = now if i == first else timer_ms
            first = next((k for k, one in enumerate(sent) if not one.acked), len(sent))
            in_recovery = first <= recovers_upto
            n_sacked = sum(one.acked for one in sent[first:])
            slack = 0 if in_recovery or n_sacked >= 3 else RTT // 4
            for k, one in enumerate(sent):
                if not one.acked and one.sent_ms + slack <= at and (one.sent_ms, k) < (at, i):
                    if not in_recovery:  # RFC 6675: the recovery point stays until it is acknowledged
                        recovers_upto = len(sent) - 1
                    send(k, now)
        first = next((k for k, one in enumerate(sent) if not one.acked), len(sent))
        sacked = any(one.acked for one in sent[first:])
        if sacked and first > recovers_upto and now == sent[first].sent_ms + RTT + RTT // 4:
            recovers_upto = len(sent) - 1
            send(first, now)
        if now % gap_ms == 0 and len(sent) < len(lost):
            sent.append(Segment(now))
            send(len(sent) - 1, now)
    got = np.maximum.accumulate([one.got_ms for one in sent])
    return [int(ms) for ms in got]


@pytest.mark.parametrize("gap_ms", [1, 4, 10, 100])
def test_a_sender_that_scans_its_scoreboard_each_millisecond_agrees(gap_ms: int) -> None:
    rng = np.random.default_rng(gap_ms)
    n = 1_500 if gap_ms == 1 else 400
    lost = rng.random((n, 12)) < 0.03
    lost[-60:] = False  # no tail
    lost[:, 8:] = False
    n_lost = [int(np.argmin(row)) for row in lost]
    theirs = ticked_ms(gap_ms, lost, n * gap_ms + 1000)
    ours = due_ms([Offer(i * gap_ms, n_lost[i]) for i in range(n)])
    late = np.array(ours) - np.arange(n) * gap_ms - 10
    other = np.array(theirs) - np.arange(n) * gap_ms - 10
    assert late.max() > 0
    if gap_ms < RTT:
        assert ours == theirs
    assert np.mean(np.abs(late - other) > 1) < 0.01  # at 100 ms a tail may be probed, which the other sender does not
    assert np.quantile(late, [0.5, 0.9, 0.99]) == pytest.approx(np.quantile(other, [0.5, 0.9, 0.99]), abs=1.5)
