"""Traffic of others: its instants against the laws of the processes, and its effect on the queue."""

from fractions import Fraction
from itertools import takewhile
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter
from scipy import stats

from tests.netem.link.queue.making import rate
from tis.common.scenario.network.capacity import Cross
from tis.common.streams import Address, Stream
from tis.netem.link.queue.cross_traffic import CrossTraffic
from tis.netem.link.queue.server import Departed, Server
from tis.netem.link.queue.transmission import Service

S = 1_000_000_000
US = 1_000
ADDRESS = Address(5, "forward", "link")
ON_OFF = {"kind": "on_off", "kbit_s": 4_000, "mean_on_s": 0.4, "mean_off_s": 1.2}
KINDS = [{"kind": "constant", "kbit_s": 1_700}, {"kind": "poisson", "kbit_s": 2_500}, ON_OFF]


def _cross(part: dict[str, Any]) -> Cross:
    return TypeAdapter(Cross).validate_python(part)


def _instants(part: dict[str, Any], from_ns: int, until_ns: int) -> list[int]:
    traffic = CrossTraffic(_cross(part), ADDRESS, from_ns)

    def walk() -> Any:
        while True:
            yield traffic.next_ns
            traffic.pass_one()

    return list(takewhile(lambda at_ns: at_ns < until_ns, walk()))


@pytest.mark.parametrize("part", KINDS, ids=lambda part: part["kind"])
def test_the_instants_do_not_depend_on_where_one_begins(part: dict[str, Any]) -> None:
    whole = _instants(part, 0, 30 * S)
    assert whole == sorted(whole)
    for from_ns in (1, 999_999_999, 12 * S, 17_345_678_901):
        assert _instants(part, from_ns, 30 * S) == [at_ns for at_ns in whole if at_ns >= from_ns]


@pytest.mark.parametrize("kbit_s", [1_700.0, 0.7, 12_345.678])
def test_constant_traffic_keeps_its_interval_for_ever(kbit_s: float) -> None:
    exact_ns = 1500 * Fraction(8_000_000) / Fraction(str(kbit_s))
    found = _instants({"kind": "constant", "kbit_s": kbit_s}, 0, int(20 * exact_ns))
    first = found[0]
    assert 0 <= first <= exact_ns
    assert all(0 <= first + i * exact_ns - at_ns < 1 for i, at_ns in enumerate(found))


def test_poisson_traffic_has_exponential_gaps() -> None:
    found = np.array(_instants(KINDS[1], 0, 200 * S))
    mean_ns = 1500 * 8e6 / 2_500
    assert len(found) == pytest.approx(200e9 / mean_ns, abs=4 * np.sqrt(200e9 / mean_ns))
    assert stats.kstest(np.diff(found) / mean_ns, "expon").pvalue > 0.001


def test_on_off_traffic_comes_at_its_interval_for_its_share_of_the_time() -> None:
    found = np.array(_instants(ON_OFF, 0, 600 * S))
    gap_ns = 1500 * 8e6 / 4_000
    assert np.median(np.diff(found)) == pytest.approx(gap_ns, abs=1)
    # 375 cycles of 1.6 s: the share of time on has a standard deviation of some 0.016
    assert len(found) * gap_ns / 600e9 == pytest.approx(0.25, abs=0.06)
    offs_s = np.diff(found)[np.diff(found) > 1.5 * gap_ns] / 1e9
    assert offs_s.mean() == pytest.approx(1.2, rel=0.2)


def test_too_many_messages_are_refused() -> None:
    with pytest.raises(ValueError, match="must be at most 50000 messages per s"):
        _cross({"kind": "poisson", "kbit_s": 1_000_000, "message_bytes": 100})


def _shared(kbit_s: float, cross: dict[str, Any], **queue: Any) -> Server:
    return Server(Service(rate(kbit_s, **queue).model_copy(update={"cross": _cross(cross)})), ADDRESS)


def test_the_mean_wait_behind_poisson_traffic_is_that_of_pollaczek_and_khinchine() -> None:
    """Rare messages of a byte see the queue as it is at any time (PASTA): the wait of an M/D/1 queue."""
    load, service_ns = 0.6, 1_500 * US
    server = _shared(8_000, {"kind": "poisson", "kbit_s": 8_000 * load})
    at_ns = np.cumsum(-np.log(Stream.named(2, "probes").uniforms(0, 20_000)) * 20e6).astype(int).tolist()
    for i, now_ns in enumerate(at_ns):
        server.offer(i, 1, now_ns)
    waits_ns = [one.left_ns - one.offered_ns - US for one in server.depart(10**18)]
    assert len(waits_ns) == len(at_ns)
    assert np.mean(waits_ns) == pytest.approx(load * service_ns / (2 * (1 - load)), rel=0.05)
    assert np.mean(np.array(waits_ns) == 0) == pytest.approx(1 - load, rel=0.03)


def test_others_take_the_places_of_a_full_queue() -> None:
    """Twice what the line carries: the queue of ten is full, nearly half of what comes is dropped, and all wait."""
    server = _shared(8_000, {"kind": "poisson", "kbit_s": 16_000}, max_packets=10)
    at_ns = np.cumsum(-np.log(Stream.named(3, "probes").uniforms(0, 4_000)) * 50e6).astype(int).tolist()
    taken = [server.offer(i, 1, now_ns) for i, now_ns in enumerate(at_ns)]
    waits_ns = [one.left_ns - one.offered_ns for one in server.depart(10**18)]
    # M/D/1/10 at load 2: the line is busy but for the rare moments at which the queue runs empty
    assert np.mean(taken) == pytest.approx(0.5, abs=0.03)
    assert max(waits_ns) <= 9 * 1_500 * US + US
    assert np.median(waits_ns) > 7 * 1_500 * US


def test_a_message_after_a_long_silence_finds_the_traffic_of_the_last_ten_seconds() -> None:
    """One that follows the traffic all along finds the same queue."""
    rare, all_along = (_shared(8_000, {"kind": "poisson", "kbit_s": 7_200}) for _ in range(2))
    for second in range(1, 3600, 5):
        all_along.offer(second, 1, second * S)
    for server in (rare, all_along):
        server.offer("last", 1, 3600 * S)
    assert rare.depart(10**18) == all_along.depart(10**18)[-1:]


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from(KINDS),
    st.lists(st.tuples(st.integers(0, 80_000 * US), st.integers(1, 3_000)), min_size=1, max_size=30),
    st.lists(st.integers(0, 2_000_000 * US), max_size=30),
)
def test_looking_changes_nothing(part: dict[str, Any], steps: list[tuple[int, int]], looks: list[int]) -> None:
    at_ns = np.cumsum([gap for gap, _ in steps]).tolist()
    offers = [(int(at), "offer", i) for i, at in enumerate(at_ns)]

    def run(events: list[tuple[int, str, int]]) -> tuple[list[int], list[Departed]]:
        server, refused, out = _shared(3_000, part, max_packets=6), [], []
        for now_ns, what, i in sorted(events):
            if what == "look":
                out += server.depart(now_ns)
            elif not server.offer(i, steps[i][1], now_ns):
                refused.append(i)
        out += server.depart(10**18)
        assert (server.n_packets, server.n_bytes, server.next_departure_ns()) == (0, 0, None)
        return refused, out

    assert run(offers) == run([*offers, *((at, "look", 0) for at in looks)])
