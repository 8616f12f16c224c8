from collections.abc import Sequence
from fractions import Fraction
from itertools import pairwise
from math import ceil

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.link.queue.making import Offered, rate, served, server_of, set_rate
from tis.common.scenario.network.capacity import Rate
from tis.common.streams import Stream
from tis.netem.link.queue.server import Departed

MS, US = 1_000_000, 1_000
STEPS = st.lists(
    st.tuples(st.sampled_from([0, 0, 7 * US, 31 * US]), st.integers(0, 60), st.integers(1, 7)),
    min_size=1,
    max_size=60,
)
BOUNDS = st.one_of(
    st.fixed_dictionaries({"max_packets": st.integers(1, 9)}),
    st.fixed_dictionaries({"max_packets": st.integers(2, 20), "max_bytes": st.integers(1, 200)}),
)


def _arrivals(steps: Sequence[tuple[int, int, int]]) -> tuple[list[Offered], list[int]]:
    at_ns = np.cumsum([gap for gap, _, _ in steps])
    offered = [Offered(int(at), n_bytes) for at, (_, n_bytes, _) in zip(at_ns, steps, strict=True)]
    return offered, [priority for _, _, priority in steps]


def _served(part: Rate, arrivals: list[Offered], priorities: list[int]) -> tuple[list[int], list[Departed]]:
    server = server_of(part)
    offers = enumerate(zip(arrivals, priorities, strict=True))
    refused = [i for i, ((at_ns, n_bytes), priority) in offers if not server.offer(i, n_bytes, at_ns, priority)]
    departed = server.depart(10**30)
    assert (server.n_packets, server.n_bytes, server.next_departure_ns()) == (0, 0, None)
    return refused, departed


def _simulated(part: Rate, arrivals: list[Offered], priorities: list[int]) -> tuple[list[int], list[Departed]]:
    """Return the same from one list that is scanned at each event, in fractions of a ns."""
    per_byte = Fraction(8_000_000) / Fraction(str(part.kbit_s))
    bounds, refused, out = part.queue, list[int](), list[Departed]()
    waiting, sending, free = list[int](), list[int](), Fraction(0)

    def fits(new: int, present: list[int]) -> bool:
        n_bytes = sum(arrivals[i].n_bytes for i in [*present, new])
        return len(present) < bounds.max_packets and (bounds.max_bytes is None or n_bytes <= bounds.max_bytes)

    def work(until: float) -> None:
        nonlocal free
        while sending and ceil(free) <= until:
            i = sending.pop()
            out.append(Departed(i, arrivals[i].at_ns, ceil(free), dropped=False))
            if waiting:
                best = min(waiting, key=lambda j: (priorities[j], j))
                waiting.remove(best)
                sending.append(best)
                free += arrivals[best].n_bytes * per_byte

    for new, (at_ns, n_bytes) in enumerate(arrivals):
        work(at_ns)
        lower = sorted((i for i in waiting if priorities[i] > priorities[new]), key=lambda i: (-priorities[i], -i))
        gone = next((n for n in range(len(lower) + 1) if fits(new, [
            i for i in [*sending, *waiting] if i not in lower[:n]
        ])), None)  # fmt: skip
        if gone is None:
            refused.append(new)
            continue
        for i in lower[:gone]:
            waiting.remove(i)
            out.append(Departed(i, arrivals[i].at_ns, at_ns, dropped=True, gives_way=True))
        if sending:
            waiting.append(new)
        else:
            sending.append(new)
            free = max(free, Fraction(at_ns)) + n_bytes * per_byte
    work(float("inf"))
    return refused, out


def test_the_higher_priority_goes_first_and_no_transmission_is_interrupted() -> None:
    server = server_of(rate(kind="priority"))
    for item, priority in (("background", 7), ("data", 5), ("real time", 1), ("data too", 5)):
        server.offer(item, 100, 0, priority)
    assert [(one.item, one.left_ns) for one in server.depart(MS)] == [
        ("background", 100 * US), ("real time", 200 * US), ("data", 300 * US), ("data too", 400 * US),
    ]  # fmt: skip


def test_a_full_queue_drops_the_newest_of_the_lowest_priority() -> None:
    server = server_of(rate(kind="priority", max_packets=4))
    for item, priority in (("sent", 7), ("older", 7), ("newer", 7), ("data", 5)):
        assert server.offer(item, 100, 0, priority)
    assert not server.offer("no better", 100, US, 7)
    assert server.offer("high", 100, 2 * US, 2)
    assert server.n_packets == 4
    assert server.depart(2 * US) == [Departed("newer", 0, 2 * US, dropped=True, gives_way=True)]
    assert [one.item for one in server.depart(MS)] == ["sent", "high", "data", "older"]


def test_nothing_gives_way_to_a_message_that_would_not_fit_even_so() -> None:
    server = server_of(rate(kind="priority", max_bytes=300))
    for item, priority in (("sent", 1), ("data", 5)):
        assert server.offer(item, 100, 0, priority)
    assert not server.offer("long", 201, 0, 1)
    assert server.offer("short", 200, 0, 1)
    assert [one.item for one in server.depart(MS)] == ["data", "sent", "short"]


@pytest.mark.parametrize("back", [False, True])
def test_messages_that_wait_are_lined_up_anew_when_the_kind_changes(back: bool) -> None:
    kinds = ("priority", "tail_drop") if back else ("tail_drop", "priority")
    server = server_of(rate(kind=kinds[0]))
    for item, priority in ((0, 5), (1, 7), (2, 1), (3, 5)):
        server.offer(item, 100, item, priority)
    set_rate(server, rate(kind=kinds[1]), 10)
    server.offer(4, 100, 20, 3)
    assert [one.item for one in server.depart(MS)] == ([0, 1, 2, 3, 4] if back else [0, 2, 4, 3, 1])


@settings(max_examples=300)
@given(STEPS, BOUNDS)
def test_a_simulation_that_scans_one_list_agrees(steps: list[tuple[int, int, int]], bounds: dict[str, int]) -> None:
    arrivals, priorities = _arrivals(steps)
    part = rate(7_777.7, kind="priority", **bounds)
    assert _served(part, arrivals, priorities) == _simulated(part, arrivals, priorities)


@given(STEPS, BOUNDS, st.integers(1, 7))
def test_with_one_priority_it_is_first_come_first_served(
    steps: list[tuple[int, int, int]], bounds: dict[str, int], priority: int
) -> None:
    arrivals, _ = _arrivals(steps)
    alike = [priority] * len(arrivals)
    assert _served(rate(kind="priority", **bounds), arrivals, alike) == served(rate(**bounds), arrivals)


@given(STEPS, BOUNDS)
def test_nothing_is_lost_but_by_the_bound_and_each_priority_keeps_its_order(
    steps: list[tuple[int, int, int]], bounds: dict[str, int]
) -> None:
    arrivals, priorities = _arrivals(steps)
    refused, departed = _served(rate(kind="priority", **bounds), arrivals, priorities)
    assert sorted([*refused, *(one.item for one in departed)]) == list(range(len(arrivals)))
    assert all(one.gives_way == one.dropped for one in departed)
    sent = [one.item for one in departed if not one.dropped]
    for priority in range(1, 8):
        assert all(a < b for a, b in pairwise(i for i in sent if priorities[i] == priority))
    roomy = rate(kind="priority", max_packets=1_000)
    assert not _served(roomy, arrivals, priorities)[0]


@given(STEPS)
def test_the_line_never_rests_while_something_waits(steps: list[tuple[int, int, int]]) -> None:
    arrivals, priorities = _arrivals(steps)
    _, ordered = _served(rate(kind="priority"), arrivals, priorities)
    _, fifo = served(rate(), arrivals)
    # the line is free at the same instant after each busy period, whatever the order within it
    assert ordered[-1].left_ns == fifo[-1].left_ns
    at_ns = [at for at, _ in arrivals]
    for now_ns in at_ns:
        left = [sum(arrivals[one.item].n_bytes for one in out if one.left_ns <= now_ns) for out in (ordered, fifo)]
        assert abs(left[0] - left[1]) <= 60  # but for the message being sent


def test_mean_waits_of_two_classes_are_those_of_cobham() -> None:
    n, service_ns, loads = 120_000, 100 * US, (0.3, 0.45)
    total = sum(loads)
    gaps = -np.log(Stream.named(3, "arrivals").uniforms(0, n)) * service_ns / total
    arrivals = [Offered(int(at_ns), 100) for at_ns in np.cumsum(gaps)]
    is_high = Stream.named(3, "classes").uniforms(0, n) < loads[0] / total
    priorities = [1 if high else 7 for high in is_high]
    _, departed = _served(rate(kind="priority", max_packets=10_000), arrivals, priorities)
    waits_ns = {1: list[int](), 7: list[int]()}
    for one in departed:
        waits_ns[priorities[one.item]].append(one.left_ns - one.offered_ns - service_ns)
    residual_ns = total * service_ns / 2  # M/D/1, not interrupted
    assert np.mean(waits_ns[1]) == pytest.approx(residual_ns / (1 - loads[0]), rel=0.03)
    assert np.mean(waits_ns[7]) == pytest.approx(residual_ns / ((1 - loads[0]) * (1 - total)), rel=0.05)
