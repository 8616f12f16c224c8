"""Control over Zenoh of a bridge in this process, with a client on either network."""

import json
import threading
import time
from collections.abc import Iterator
from typing import Any, get_args

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_client, a_router, soon
from tests.netem.bridge.controlled_bridge import BASE, Running, running_bridge
from tests.netem.making import link
from tis.common.channels import Direction
from tis.common.runtime.ports import free_endpoints
from tis.common.scenario.control import Acknowledgement, EmulatorState, Operation
from tis.netem.bridge.bridge import Bridge
from tis.netem.bridge.control import BridgeControl

pytestmark = pytest.mark.live

MS = 1_000_000


@pytest.fixture
def running() -> Iterator[Running]:
    with running_bridge() as made:
        yield made


def _slow(delay_ms: float) -> dict[str, Any]:
    return {"direction": "forward", "change": {"delay": {"kind": "constant", "delay_ms": delay_ms}}}


def _soon_crosses(running: Running) -> bool:
    """Tell whether 20 messages of 20 cross without the 50 ms, soon: a busy machine may hold up a burst or more."""

    def crosses() -> bool:
        late_ms = running.burst(20)
        assert len(late_ms) == 20
        return max(late_ms) < 40

    return soon(crosses)


def test_set_outage_and_reset_do_what_they_say_and_are_logged(running: Running) -> None:
    assert _soon_crosses(running)
    done = Acknowledgement.model_validate(running.ask("set", _slow(50)))
    assert done.accepted
    assert done.at_ns is not None
    assert done.from_ns is not None
    assert done.at_ns < done.from_ns <= done.at_ns + MS
    time.sleep(0.002)
    late_ms = running.burst(20)
    assert len(late_ms) == 20
    assert min(late_ms) >= 50
    state = EmulatorState.model_validate(running.ask("state"))
    assert state.forward is not None
    assert state.forward.now.model_dump(exclude_none=True) == {
        "delay": {"kind": "constant", "delay_ms": 50.0}, "ordering": "fifo",
    }  # fmt: skip
    assert state.forward.counters["dropped.outage"] == 0

    out = running.ask("outage", {"for_ms": 300}, running.east)  # either network will do
    assert out["accepted"]
    time.sleep(0.002)
    n_heard = len(running.heard)
    for _ in range(10):
        running.send()
    time.sleep(0.32)
    assert len(running.heard) == n_heard
    assert running.ask("state")["forward"]["counters"]["dropped.outage"] == 10

    assert running.ask("reset")["accepted"]
    time.sleep(0.002)
    assert _soon_crosses(running)
    assert soon(lambda: len(running.notes()) == 3)
    assert [(note.operation, note.accepted, note.at_ns) for note in running.notes()] == [
        ("set", True, done.at_ns), ("outage", True, out["at_ns"]), ("reset", True, running.notes()[2].at_ns),
    ]  # fmt: skip


def test_what_is_put_is_acknowledged_and_crosses_neither_way(running: Running) -> None:
    answers: list[dict[str, Any]] = []

    def hear(sample: zenoh.Sample) -> None:
        answers.append(json.loads(sample.payload.to_bytes()))

    with running.west.declare_subscriber(f"{BASE}/acknowledged", hear):
        time.sleep(0.1)
        before = running.bridge.links["forward"].offered
        running.west.put(f"{BASE}/set", json.dumps(_slow(20) | {"id": "mine"}))
        running.west.put(f"{BASE}/set", b"\xff")
        running.west.put(f"{BASE}/sett", b"{}")
        running.west.put(f"{BASE}/set", bytes(70_000))
        assert soon(lambda: len(answers) == 4)
        running.burst(5)
    assert [(one["id"], one["accepted"], one["operation"]) for one in answers] == [
        ("mine", True, "set"), (None, False, "set"), (None, False, "sett"), (None, False, "set"),
    ]  # fmt: skip
    assert "must have at most 65536 bytes (got 70000)" in answers[3]["reasons"][0]
    assert running.stray == []
    assert running.bridge.links["forward"].offered == before + 5
    assert running.bridge.links["feedback"].offered == 0


def test_requests_during_traffic_lose_no_message(running: Running) -> None:
    done = threading.Event()

    def pester() -> None:
        number = 0
        while not done.is_set():
            number += 1
            request = json.dumps(_slow(number % 5)) if number % 2 else "junk" * 1000
            running.west.put(f"{BASE}/set", request)
            time.sleep(0.002)

    pestering = threading.Thread(target=pester)
    pestering.start()
    late_ms = running.burst(500)
    done.set()
    pestering.join()
    assert len(late_ms) == 500
    assert running.bridge.counters()["control.accepted"] > 20  # the table at the end says "with changes" by it
    assert running.control.counters()["control.refused"] > 20


def test_a_flood_is_dropped_and_counted_and_the_next_request_is_answered(running: Running) -> None:
    for number in range(2_000):
        running.west.put(f"{BASE}/set", json.dumps(_slow(number)))
    assert soon(lambda: sum(running.control.counters().values()) >= 2_000)
    assert running.control.counters()["control.flooded"] > 0
    assert running.ask("reset")["accepted"]
    assert len(running.burst(20)) == 20


def test_the_schema_of_requests_is_answered(running: Running) -> None:
    schema = running.ask("schema")
    assert set(schema["properties"]) == set(get_args(Operation))
    assert set(schema["$defs"]["OutageRequest"]["properties"]) == {"id", "direction", "for_ms", "effect"}


def test_who_asks_for_everything_does_not_mean_the_emulator(running: Running) -> None:
    replies = [reply.ok for reply in running.west.get("**", timeout=1) if reply.ok is not None]
    assert replies == []
    (only,) = [reply.ok for reply in running.west.get(f"{BASE}/*", timeout=1) if reply.ok is not None]
    assert str(only.key_expr) == f"{BASE}/state"


def test_before_the_run_nothing_can_be_changed() -> None:
    west, east = free_endpoints()
    with a_router(west) as one, a_router(east) as two, a_client(west) as client:
        bridge = Bridge({"west": one, "east": two}, {way: link(way) for way in get_args(Direction)})
        control = BridgeControl(bridge, {"west": one, "east": two}, prefix="lab")
        control.open()
        try:
            replies = [client.get(f"lab/netem/control/{key}", timeout=3) for key in ("state", "reset")]
            state, reset = [json.loads(next(iter(one)).ok.payload.to_bytes()) for one in replies]  # type: ignore[union-attr]
        finally:
            control.close()
            bridge.close()
    assert state == {"running": False, "standalone": False, "unmatched": "refuse", "counters": {}}
    assert reset["reasons"] == ["control: must come while messages pass: not before the run begins, nor after it"]
