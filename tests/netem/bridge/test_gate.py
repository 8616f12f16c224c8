"""Senders that a full queue holds back: who waits, how long, and that nothing else does."""

import threading
import time
from typing import Any

import pytest
import zenoh

from tests.netem.bridge.live_bridge import Bridged, a_bridge
from tests.netem.making import KEY, link, offer, packet
from tis.common.errors import InputError
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.conditions import Change
from tis.netem.bridge.gate import MAX_WAITING, Gate, Visit, gates_for, without_gates
from tis.netem.link.link import Door

MS = 1_000_000
FULL, FREE = Door("link", False), Door("link", True)


def _held(gate: Gate, priority: int, at_ns: int = 0) -> Visit:
    visit = gate.visit(priority)
    assert gate.must_wait(visit, FULL, at_ns)
    return visit


def test_who_finds_room_or_no_door_goes_on() -> None:
    gate = Gate(lease_s=2)
    for door in (FREE, None):
        assert not gate.must_wait(gate.visit(5), door, 0)
    assert (gate.n_held_back, gate.n_overdue) == (0, 0)


def test_the_highest_priority_goes_first_and_then_the_earliest() -> None:
    gate = Gate(lease_s=2)
    background, data, later, urgent = (_held(gate, priority) for priority in (7, 5, 5, 1))
    newcomer = gate.visit(5)
    assert gate.must_wait(newcomer, FREE, 0)  # no room is left for it: others came before
    left = []
    for _ in range(5):
        gate.ring()
        waiting = [one for one in (background, data, later, urgent, newcomer) if one not in left]
        rung = [one for one in waiting if one.bell.is_set()]
        assert rung == [one for one in waiting if not gate.must_wait(one, FREE, 0)]
        gate.leave(rung[0])
        left += rung
    assert left == [urgent, data, later, newcomer, background]
    assert gate.n_held_back == 5


def test_queues_of_other_keys_have_lines_of_their_own() -> None:
    gate = Gate(lease_s=2)
    _held(gate, 1)
    assert not gate.must_wait(gate.visit(7), Door("rule/**", True), 0)


def test_nobody_waits_longer_than_half_the_lease_and_not_too_many_at_once() -> None:
    gate = Gate(lease_s=2, most=1)
    visit = _held(gate, 5, at_ns=7)
    assert gate.must_wait(visit, FULL, 1000 * MS + 6)
    assert not gate.must_wait(gate.visit(1), FULL, 8)
    assert not gate.must_wait(visit, FULL, 1000 * MS + 7)
    assert (gate.n_held_back, gate.n_overdue) == (1, 2)


def test_a_link_tells_whether_a_full_queue_pushes_back() -> None:
    rate: dict[str, Any] = {"kbit_s": 27, "queue": {"kind": "tail_drop", "max_packets": 1}, "backpressure": True}
    made = link(forward={"rate": rate}, timeline=[{"at_s": 1, "for_s": 1, "set": {"outage": True}}])
    assert made.door(KEY, 27, 0) == FREE
    offer(made, packet(0, 0), 0)
    assert made.door(KEY, 27, 8 * MS - 1) == FULL
    assert made.door(KEY, 27, 8 * MS) == FREE  # the transmission has ended
    assert made.door("refused/key", 27, 0) is None
    offer(made, packet(999 * MS, 1), 999 * MS)
    assert made.door(KEY, 27, 1_000 * MS) is None  # what is offered in an outage is lost
    plain = link(forward={"rate": {**rate, "backpressure": False}})
    offer(plain, packet(0, 0), 0)
    assert plain.door(KEY, 27, 0) is None
    bounded = link(forward={"rate": {**rate, "queue": {"kind": "tail_drop", "max_bytes": 20}}})
    assert bounded.door(KEY, 27, 0) == FREE  # longer than the queue: it never passes, and nobody waits for that


def test_back_pressure_stands_in_any_part_of_a_network() -> None:
    rate = {"rate": {"kbit_s": 8, "backpressure": True}}
    parts: tuple[dict[str, Any], ...] = (
        {"feedback": rate},
        {"rules": [{"key": "a", "direction": "both", "pipeline": rate}]},
        {"timeline": [{"at_s": 1, "set": rate}]},
        {"states": {"kind": "cycle", "states": [{"name": "one", "for_s": 1, "feedback": rate}]}},
    )
    assert all(NetworkPart.model_validate(part).pushes_back for part in parts)
    assert not NetworkPart.model_validate({"forward": {"rate": {"kbit_s": 8}}}).pushes_back


def test_back_pressure_cannot_begin_later() -> None:
    without_gates(Change.model_validate({"rate": {"kbit_s": 8}}))
    with pytest.raises(InputError, match="must hold from the start of netem on"):
        without_gates(Change.model_validate({"rate": {"kbit_s": 8, "backpressure": True}}))


@pytest.mark.parametrize(("runtime", "most"), [(None, MAX_WAITING), ("(rx: (worker_threads: 3))", 1)])
def test_the_user_may_have_set_how_many_threads_receive(
    monkeypatch: pytest.MonkeyPatch, runtime: str | None, most: int
) -> None:
    monkeypatch.setenv("ZENOH_RUNTIME", runtime or "")
    if runtime is None:
        monkeypatch.delenv("ZENOH_RUNTIME")
    network = NetworkPart.model_validate({"forward": {"rate": {"kbit_s": 8, "backpressure": True}}})
    gates, options = gates_for(network, 2.0, ZenohOptions())
    held = [gates["forward"].must_wait(gates["forward"].visit(5), FULL, 0) for _ in range(MAX_WAITING + 1)]
    assert sum(held) == most
    assert configure("client", options).get_json("transport/link/tcp/so_rcvbuf") == "65536"


def test_without_back_pressure_there_is_no_gate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ZENOH_RUNTIME", "")
    assert gates_for(NetworkPart(), 2.0, ZenohOptions()) == ({}, ZenohOptions())


def _flood(there: Bridged, n: int) -> threading.Thread:
    publisher = there.west.declare_publisher("demo/flood", congestion_control=zenoh.CongestionControl.BLOCK)
    thread = threading.Thread(target=lambda: [publisher.put(bytes(1000)) for _ in range(n)])
    thread.start()
    return thread


@pytest.mark.live
def test_a_sender_that_blocks_loses_nothing_and_the_other_way_is_open() -> None:
    n = 300
    rate = {"kbit_s": 8_000, "queue": {"kind": "priority", "max_packets": 5}, "backpressure": True}
    with a_bridge(forward={"rate": rate}) as there:
        arrived, back, done = list[str](), threading.Event(), threading.Event()

        def take(sample: zenoh.Sample) -> None:
            arrived.append(str(sample.key_expr))
            if len(arrived) == n:
                done.set()

        there.east.declare_subscriber("demo/**", take)
        there.west.declare_subscriber("back/**", lambda _: back.set())
        time.sleep(0.3)
        thread = _flood(there, n)
        while not there.bridge.counters()["forward.held_back"]:
            time.sleep(0.001)
        there.east.put("back/a", b"")
        assert back.wait(20)
        assert done.wait(20)
        thread.join()
        counters = there.bridge.counters()
        assert (counters["forward.offered"], counters["forward.dropped.queue_full"]) == (n, 0)


@pytest.mark.live
def test_the_end_waits_for_no_room() -> None:
    rate = {"kbit_s": 0.1, "queue": {"kind": "tail_drop", "max_packets": 1}, "backpressure": True}
    with a_bridge(forward={"rate": rate}, lease_s=1000) as there:
        time.sleep(0.3)
        thread = _flood(there, 3)
        while not there.bridge.counters()["forward.held_back"]:
            time.sleep(0.001)
    thread.join()
    assert there.bridge.counters()["forward.offered"] == 1
