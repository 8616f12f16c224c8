from fractions import Fraction
from heapq import heappop, heappush
from itertools import pairwise
from math import ceil
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.link.queue.making import Offered, rate, served, server_of, set_rate, simulated
from tis.common.scenario.network.capacity import Rate
from tis.common.streams import Stream
from tis.netem.link.queue.server import Departed

US = 1_000
MS = 1_000_000
QUICK_CODEL: dict[str, Any] = {"kind": "codel", "target_ms": 0.02, "interval_ms": 0.1}
"""With a target of 20 and an interval of 100 transmission times of a byte at 8000 kbit/s."""

GAPS = st.one_of(st.just(0), st.integers(0, 30 * US), st.integers(0, 500 * US))
ARRIVALS = st.lists(st.tuples(GAPS, st.integers(0, 60)), min_size=1, max_size=80)
QUEUES = st.one_of(
    st.fixed_dictionaries({"kind": st.just("tail_drop"), "max_packets": st.integers(1, 12)}),
    st.fixed_dictionaries({"kind": st.just("tail_drop"), "max_bytes": st.integers(1, 200)}),
    st.just(QUICK_CODEL),
    st.just(QUICK_CODEL | {"max_packets": 9, "max_bytes": 250}),
)
PARTS = st.builds(
    lambda kbit_s, overhead, queue: rate(kbit_s, overhead, **queue),
    st.sampled_from([8_000.0, 7_777.7, 24_000.0]),
    st.sampled_from([0, 3]),
    QUEUES,
)


def _arrivals(steps: list[tuple[int, int]]) -> list[Offered]:
    at_ns = np.cumsum([gap for gap, _ in steps])
    return [Offered(int(at), n_bytes) for at, (_, n_bytes) in zip(at_ns, steps, strict=True)]


def _evenly(n: int, every_ns: int, n_bytes: int, from_ns: int = 0) -> list[Offered]:
    return [Offered(from_ns + i * every_ns, n_bytes) for i in range(n)]


def test_messages_of_two_keys_share_the_rate_first_come_first_served() -> None:
    server = server_of(rate(8_000, overhead_bytes=10))
    for item in (("a", 0), ("b", 0), ("a", 1)):
        assert server.offer(item, 90, 1 * MS)
    assert (server.n_packets, server.n_bytes) == (3, 300)
    assert server.next_departure_ns() == 1 * MS + 100 * US
    assert server.depart(1 * MS + 100 * US - 1) == []
    assert server.depart(1 * MS + 200 * US) == [
        Departed(("a", 0), 1 * MS, 1 * MS + 100 * US, False),
        Departed(("b", 0), 1 * MS, 1 * MS + 200 * US, False),
    ]
    assert (server.n_packets, server.n_bytes) == (1, 100)
    assert server.depart(2 * MS) == [Departed(("a", 1), 1 * MS, 1 * MS + 300 * US, False)]
    assert server.next_departure_ns() is None


def test_bounds_count_the_message_in_transmission() -> None:
    server = server_of(rate(max_packets=2))
    assert [server.offer(i, 100, 0) for i in range(3)] == [True, True, False]
    assert not server.offer(3, 100, 100 * US - 1)
    assert server.offer(4, 100, 100 * US)  # what ends at an instant makes room for what comes then
    assert [departed.item for departed in server.depart(1 * MS)] == [0, 1, 4]


def test_bounds_in_bytes_include_the_overhead_and_are_reached_exactly() -> None:
    server = server_of(rate(overhead_bytes=20, max_bytes=300))
    assert server.offer("first", 130, 0)
    assert not server.offer("a byte too long", 131, 0)
    assert server.offer("fits", 130, 0)
    assert not server.offer("overhead alone", 0, 0)
    assert server.n_bytes == 300
    assert not server_of(rate(overhead_bytes=20, max_bytes=300)).offer("longer than the queue", 281, 0)


def test_codel_has_a_door_too() -> None:
    server = server_of(rate(**QUICK_CODEL, max_packets=2))
    assert [server.offer(i, 100, 0) for i in range(3)] == [True, True, False]


def test_departures_that_an_offer_passes_over_are_kept() -> None:
    server = server_of(rate())
    server.offer("early", 100, 0)
    server.offer("late", 100, 1 * MS)
    assert server.next_departure_ns() == 100 * US
    assert [departed.left_ns for departed in server.depart(2 * MS)] == [100 * US, 1 * MS + 100 * US]


def test_an_instant_before_the_latest_counts_as_the_latest() -> None:
    server = server_of(rate())
    server.offer("late", 100, 1 * MS)
    server.offer("earlier", 100, 0)
    assert server.depart(0) == []
    departed = [Departed("late", MS, MS + 100 * US, False), Departed("earlier", MS, MS + 200 * US, False)]
    assert server.depart(2 * MS) == departed


def test_the_throughput_of_a_long_run_is_exact() -> None:
    n, n_bytes = 200_000, 257
    part = rate(1544, overhead_bytes=42, max_packets=n)
    _, departed = served(part, [Offered(5, n_bytes)] * n)
    exact_ns = n * (n_bytes + 42) * Fraction(8_000_000, 1544)
    assert departed[-1].left_ns == 5 + ceil(exact_ns)
    # ... and so is each of them: nothing is put off to the end
    for i in range(0, n, 997):
        assert departed[i].left_ns == 5 + ceil(exact_ns * (i + 1) / n)


@settings(max_examples=300)
@given(PARTS, ARRIVALS)
def test_the_simulation_of_the_whole_list_agrees(part: Rate, steps: list[tuple[int, int]]) -> None:
    arrivals = _arrivals(steps)
    assert served(part, arrivals) == simulated(part, arrivals)


@pytest.mark.parametrize("load", [0.7, 0.97, 1.05, 1.6, 4.0])
@pytest.mark.parametrize("kind", ["tail_drop", "codel"])
def test_the_simulation_agrees_under_random_load(load: float, kind: Literal["tail_drop", "codel"]) -> None:
    queue = QUICK_CODEL | {"max_packets": 60} if kind == "codel" else {"kind": "tail_drop", "max_packets": 25}
    u = Stream.named(1, f"{load}").uniforms(0, 6_000)
    at_ns = np.cumsum(-np.log(u[:3_000]) * 10 * US / load).astype(np.int64)
    sizes = (1 + 19 * u[3_000:]).astype(np.int64)  # 10 bytes, so 10 us, on average
    arrivals = [Offered(int(at), int(n_bytes)) for at, n_bytes in zip(at_ns, sizes, strict=True)]
    refused, departed = served(rate(**queue), arrivals)
    assert (refused, departed) == simulated(rate(**queue), arrivals)
    if load > 1.0:
        assert refused if kind == "tail_drop" else any(one.dropped for one in departed)


LOOKS = st.lists(st.tuples(st.integers(0, 3_000 * US), st.sampled_from(["look", "depart"])), max_size=30)


@settings(max_examples=200)
@given(PARTS, ARRIVALS, LOOKS)
def test_looking_changes_nothing_and_nothing_is_lost(
    part: Rate, steps: list[tuple[int, int]], looks: list[tuple[int, str]]
) -> None:
    arrivals = _arrivals(steps)
    events = [(at_ns, "offer", i) for i, (at_ns, _) in enumerate(arrivals)] + [(at, what, 0) for at, what in looks]
    server, refused, departed = server_of(part), [], []
    n_offered = 0
    for now_ns, what, i in sorted(events, key=lambda event: event[0]):
        promised_ns = server.next_departure_ns()
        if what == "offer":
            n_offered += 1
            if not server.offer(i, arrivals[i].n_bytes, now_ns):
                refused.append(i)
        elif what == "depart":
            left = server.depart(now_ns)
            assert all(one.left_ns <= now_ns for one in left)
            assert bool(left) == (promised_ns is not None and promised_ns <= now_ns)
            assert not left or left[0].left_ns == promised_ns
            departed += left
            assert n_offered == len(departed) + len(refused) + server.n_packets
        assert (server.n_packets == 0) == (server.n_bytes == 0) or part.overhead_bytes == 0
    departed += server.depart(10**30)
    assert (refused, departed) == served(part, arrivals)


@given(PARTS, ARRIVALS)
def test_order_is_kept_and_nothing_is_faster_than_the_line(part: Rate, steps: list[tuple[int, int]]) -> None:
    arrivals = _arrivals(steps)
    refused, departed = served(part, arrivals)
    assert sorted([*refused, *(one.item for one in departed)]) == list(range(len(arrivals)))
    assert all(a.left_ns <= b.left_ns and a.item < b.item for a, b in pairwise(departed))
    per_byte = Fraction(8_000_000) / Fraction(str(part.kbit_s))
    for one in departed:
        at_ns, n_bytes = arrivals[one.item]
        assert one.offered_ns == at_ns
        least_ns = 0 if one.dropped else (n_bytes + part.overhead_bytes) * per_byte
        assert one.left_ns - at_ns >= least_ns


def test_mean_wait_is_that_of_pollaczek_and_khinchine() -> None:
    load, n, service_ns = 0.7, 150_000, 100 * US
    gaps = -np.log(Stream.named(3, "arrivals").uniforms(0, n)) * service_ns / load
    arrivals = [Offered(int(at_ns), 100) for at_ns in np.cumsum(gaps)]
    _, departed = served(rate(max_packets=10_000), arrivals)
    waits_ns = np.array([one.left_ns - one.offered_ns - service_ns for one in departed])
    # M/D/1: half the mean wait of M/M/1
    assert np.mean(waits_ns) == pytest.approx(load * service_ns / (2 * (1 - load)), rel=0.03)
    assert np.mean(waits_ns == 0) == pytest.approx(1 - load, rel=0.02)  # the chance to find nobody, by PASTA


def _waits_of_a_sender_that_reacts(queue: dict[str, Any], for_s: int = 60) -> tuple[np.ndarray[Any, Any], float]:
    """Return the waits in ms of the second half, and the share of that time in which the line was busy.

    A window of messages is under way, 20 ms on top of the wait and the 1 ms that each takes; it grows by one a round
    trip, and halves when one is dropped, at most once a round trip (AIMD, as TCP Reno).
    """
    server, window, n_sent, n_under_way = server_of(rate(**queue)), 2.0, 0, 0
    heard: list[tuple[int, bool]] = [(0, False)]
    deaf_until_ns, waits_ms, n_late_half = 0, [], 0
    while True:
        leaves_ns = server.next_departure_ns()
        if leaves_ns is not None and (not heard or leaves_ns <= heard[0][0]):
            for one in server.depart(leaves_ns):
                heappush(heard, (one.left_ns + 20 * MS, one.dropped))
                if not one.dropped and one.left_ns > for_s * 500 * MS:
                    waits_ms.append((one.left_ns - one.offered_ns) / MS - 1)
                    n_late_half += 1
            continue
        now_ns, dropped = heappop(heard)
        if now_ns > for_s * 1_000 * MS:
            return np.array(waits_ms), n_late_half / (for_s * 500)
        n_under_way = max(0, n_under_way - 1)
        if not dropped:
            window += 1 / window
        elif now_ns >= deaf_until_ns:
            window, deaf_until_ns = max(1.0, window / 2), now_ns + 25 * MS
        while n_under_way < int(window):
            n_under_way += 1
            n_sent += 1
            if not server.offer(n_sent, 1_000, now_ns):
                heappush(heard, (now_ns + 20 * MS, True))


class TestCoDelAtWork:
    """At 8 Mbit/s a byte takes 1 us; target 5 ms and interval 100 ms by default."""

    def test_a_sender_that_reacts_is_driven_to_about_the_target(self) -> None:
        waits_ms, busy = _waits_of_a_sender_that_reacts({"kind": "codel"})
        assert 2 < np.median(waits_ms) < 8
        assert np.quantile(waits_ms, 0.95) < 20
        assert busy > 0.9  # 0.75 is what halving leaves where nothing can wait
        bloated_ms, _ = _waits_of_a_sender_that_reacts({"kind": "tail_drop", "max_packets": 100})
        assert np.median(bloated_ms) > 50

    def test_a_sender_that_does_not_react_loses_what_is_too_much(self) -> None:
        # 10 % more than fits, in messages of 0.1 ms, for 12 s; a target of 0.5 ms
        arrivals = _evenly(132_000, 100 * US * 10 // 11, 100)
        part = rate(kind="codel", target_ms=0.5, interval_ms=10, max_packets=100_000)
        refused, departed = served(part, arrivals)
        assert refused == []
        late = departed[22_000:]
        assert np.mean([one.dropped for one in late]) == pytest.approx(1 / 11, rel=0.02)
        # it stands above the target, since nobody slows down, but no longer grows: 1.2 s without CoDel
        assert 0.5 * MS < np.mean([one.left_ns - one.offered_ns for one in late]) < 5 * MS

    def test_a_burst_shorter_than_the_interval_loses_nothing(self) -> None:
        bursts = [Offered(k * 200 * MS, 1_000) for k in range(50) for _ in range(90)]  # 90 ms of work, every 200 ms
        refused, departed = served(rate(kind="codel"), bursts)
        assert refused == []
        assert not any(one.dropped for one in departed)

    def test_a_burst_longer_than_the_interval_loses_some(self) -> None:
        _, departed = served(rate(kind="codel"), [Offered(0, 1_000)] * 300)
        dropped_ms = [one.left_ns / MS for one in departed if one.dropped]
        # above the target from the turn of the 6th on; then after 100, 100 / sqrt 2 ... ms, at the next turn
        assert dropped_ms == [105, 205, 276]

    def test_a_queue_of_at_most_one_longest_message_is_left_alone(self) -> None:
        slow = rate(kbit_s=1_000, kind="codel")  # 1250 bytes take 10 ms, twice the target
        # each waits 10 ms for the one before it, and nothing is behind it
        arrivals = [Offered(0, 1_250), *_evenly(2_000, 10 * MS, 1_250, from_ns=1)]
        _, departed = served(slow, arrivals)
        assert min(one.left_ns - one.offered_ns for one in departed[1:]) == 20 * MS - 1
        assert not any(one.dropped for one in departed)
        # with one more always behind it, it is a standing queue
        _, departed = served(slow, [*[Offered(0, 1_250)] * 2, *arrivals])
        assert any(one.dropped for one in departed)


class TestChangeOfRate:
    def test_what_is_left_of_a_transmission_goes_at_the_new_rate(self) -> None:
        server = server_of(rate(8_000))
        for i in range(3):
            server.offer(i, 100, 0)
        set_rate(server, rate(80_000), 150 * US)  # half of the second one has gone
        assert [one.left_ns for one in server.depart(1 * MS)] == [100 * US, 155 * US, 165 * US]

    def test_equal_parameters_change_nothing(self) -> None:
        arrivals = _evenly(500, 7 * US, 10)
        expected = served(rate(**QUICK_CODEL), arrivals)
        server = server_of(rate(**QUICK_CODEL))
        for i, (at_ns, n_bytes) in enumerate(arrivals):
            part = rate(**QUICK_CODEL)
            set_rate(server, part, at_ns)
            assert server.service.capacity is part
            server.offer(i, n_bytes, at_ns)
        assert server.depart(10**30) == expected[1]
        assert any(one.dropped for one in expected[1])

    def test_nothing_that_waits_is_thrown_out(self) -> None:
        server = server_of(rate(max_packets=5))
        for i in range(5):
            server.offer(i, 100, 0)
        set_rate(server, rate(max_packets=2, overhead_bytes=50), 0)
        assert not server.offer("no room", 100, 300 * US)
        assert server.offer("room", 100, 400 * US)
        # the overhead holds for what is offered under it
        assert [one.left_ns for one in server.depart(1 * MS)] == [*range(100 * US, 501 * US, 100 * US), 650 * US]

    def test_codel_continues_at_another_bit_rate_and_restarts_with_other_parameters(self) -> None:
        def dropped_ms(after: Rate) -> list[float]:
            server = server_of(rate(kind="codel"))
            for i in range(300):
                server.offer(i, 1_000, 0)
            set_rate(server, after, 210 * MS)  # when two have been dropped
            return [one.left_ns / MS for one in server.depart(10**12) if one.dropped]

        assert dropped_ms(rate(kind="codel", max_packets=400)) == [105, 205, 276]
        assert dropped_ms(rate(kind="codel", interval_ms=50)) == [105, 205, 261]
        assert dropped_ms(rate()) == [105, 205]

    def test_a_server_that_nothing_is_offered_to_drains_at_its_own_rate(self) -> None:
        server = server_of(rate())
        for i in range(3):
            server.offer(i, 100, 0)
        instants = []
        while (next_ns := server.next_departure_ns()) is not None:
            instants += [one.left_ns for one in server.depart(next_ns)]
        assert instants == [100 * US, 200 * US, 300 * US]

    @given(ARRIVALS, st.lists(st.tuples(st.integers(0, 2_000 * US), PARTS), max_size=6))
    def test_conservation_and_order_whatever_the_rate_does(
        self, steps: list[tuple[int, int]], changes: list[tuple[int, Rate]]
    ) -> None:
        arrivals = _arrivals(steps)
        events: list[tuple[int, Rate | int]] = [(at_ns, i) for i, (at_ns, _) in enumerate(arrivals)]
        server, refused = server_of(rate()), []
        for now_ns, what in sorted(events + list(changes), key=lambda event: event[0]):
            if isinstance(what, Rate):
                set_rate(server, what, now_ns)
            elif not server.offer(what, arrivals[what].n_bytes, now_ns):
                refused.append(what)
        departed = server.depart(10**30)
        assert sorted([*refused, *(one.item for one in departed)]) == list(range(len(arrivals)))
        assert all(a.left_ns <= b.left_ns and a.item < b.item for a, b in pairwise(departed))
        assert all(one.offered_ns <= one.left_ns for one in departed)
