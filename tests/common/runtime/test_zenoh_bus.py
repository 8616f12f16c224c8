"""The bus of netem between two real networks: what goes in on one side comes out on the other, untouched, once."""

import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field

import pytest
import zenoh

from common.channels import Network
from common.header import Header
from common.node import Arrival, Emission, Output, Record
from common.runtime.clock import WallClock
from common.runtime.inbox import Inbox
from common.runtime.zenoh_bus import ZenohBus, passport_of
from tests.common.runtime.live_zenoh import Network as Nodes
from tests.common.runtime.live_zenoh import a_network, soon

pytestmark = pytest.mark.live
OTHER: dict[Network, Network] = {"west": "east", "east": "west"}
_LIMIT_NS = 3_000_000_000


class Ears:
    """A node that only listens."""

    name = "netem"

    def __init__(self, *keys: tuple[Network, str]) -> None:
        self.keys = keys

    def listens(self) -> Sequence[tuple[Network, str]]:
        return self.keys

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        return ()

    def wake(self, now_ns: int) -> Sequence[Output]:
        return ()

    def next_wake_ns(self) -> int | None:
        return None

    def finish(self, now_ns: int) -> Sequence[Record]:
        return ()

    def counters(self) -> dict[str, int]:
        return {}


@dataclass
class Bridge:
    """Two networks with a bus between them that forwards at once, in a thread of its own."""

    west: Nodes
    east: Nodes
    bus: ZenohBus
    arrivals: list[Arrival] = field(default_factory=list)
    stopped: threading.Event = field(default_factory=threading.Event)

    def forward(self) -> None:
        while not self.stopped.is_set():
            delivery = self.bus.wait(self.bus.clock.now_ns() + 20_000_000)
            if delivery is None:
                continue
            arrival = delivery.arrival
            self.arrivals.append(arrival)
            self.bus.send(
                0,
                Emission(
                    OTHER[arrival.network],
                    arrival.key,
                    arrival.payload,
                    arrival.attachment,
                    lambda _: (),
                    arrival.passport,
                ),
            )

    def hear(self, nodes: Nodes, key: str = "**") -> list[zenoh.Sample]:
        heard: list[zenoh.Sample] = []
        self._held.append(nodes.client.declare_subscriber(key, heard.append))
        time.sleep(0.1)  # the declaration has to reach the sender's router, and nothing tells when it has
        return heard

    _held: list[object] = field(default_factory=list)


@pytest.fixture
def bridge() -> Iterator[Bridge]:
    with ExitStack() as stack:
        west, east = stack.enter_context(a_network()), stack.enter_context(a_network())
        clock = WallClock(time.monotonic_ns())
        inbox: Inbox[zenoh.Sample] = Inbox()
        inbox.start(clock)
        bus = ZenohBus({"west": west.router, "east": east.router}, clock, inbox, forwards=True)
        bus.listen(Ears(("west", "**"), ("east", "**")))
        found = Bridge(west, east, bus)
        thread = threading.Thread(target=found.forward, daemon=True)
        thread.start()
        yield found
        found.stopped.set()
        thread.join(5)
        assert inbox.error is None


@pytest.mark.parametrize("direction", ["west to east", "east to west"])
def test_all_that_a_sample_carries_crosses_unchanged_and_once(bridge: Bridge, direction: str) -> None:
    here, there = (bridge.west, bridge.east) if direction == "west to east" else (bridge.east, bridge.west)
    heard, echoes = bridge.hear(there), bridge.hear(here)
    stamp = here.client.new_timestamp()
    here.client.put(
        "s/a/b",
        bytes(range(256)) * 40,
        encoding="application/x-made-up;schema",
        attachment=b"\x00\xff not a header",
        timestamp=stamp,
        priority=zenoh.Priority.DATA_LOW,
        express=True,
        congestion_control=zenoh.CongestionControl.BLOCK,
    )
    assert soon(lambda: bool(heard))
    time.sleep(0.2)  # a second copy, an echo or a loop would come by now
    assert len(heard) == 1
    assert len(bridge.arrivals) == 1
    sample = heard[0]
    assert sample.kind == zenoh.SampleKind.PUT
    assert str(sample.key_expr) == "s/a/b"
    assert sample.payload.to_bytes() == bytes(range(256)) * 40
    assert str(sample.encoding) == "application/x-made-up;schema"
    assert sample.attachment is not None
    assert sample.attachment.to_bytes() == b"\x00\xff not a header"
    assert sample.timestamp == stamp
    assert sample.priority == zenoh.Priority.DATA_LOW
    assert sample.express is True
    assert sample.congestion_control == zenoh.CongestionControl.BLOCK
    # what the sender's own network hears is the sender's message alone
    assert len(echoes) == 1


def test_a_delete_crosses_as_a_delete(bridge: Bridge) -> None:
    heard = bridge.hear(bridge.east)
    bridge.west.client.delete(
        "s/a/b", attachment=b"why", priority=zenoh.Priority.INTERACTIVE_HIGH, express=False,
        congestion_control=zenoh.CongestionControl.DROP,
    )  # fmt: skip
    assert soon(lambda: bool(heard))
    sample = heard[0]
    assert sample.kind == zenoh.SampleKind.DELETE
    assert sample.attachment is not None
    assert sample.attachment.to_bytes() == b"why"
    assert (sample.priority, sample.express) == (zenoh.Priority.INTERACTIVE_HIGH, False)
    assert sample.congestion_control == zenoh.CongestionControl.DROP


def test_what_a_sample_lacks_it_lacks_on_the_other_side_too(bridge: Bridge) -> None:
    """No attachment does not become an empty one; an empty payload stays empty."""
    heard = bridge.hear(bridge.east)
    bridge.west.client.put("s/a/b", b"")
    assert soon(lambda: bool(heard))
    assert heard[0].attachment is None
    assert heard[0].payload.to_bytes() == b""
    assert heard[0].encoding == zenoh.Encoding.ZENOH_BYTES


def test_many_messages_cross_in_order_and_none_twice(bridge: Bridge) -> None:
    heard = bridge.hear(bridge.east, "s/*")
    back = bridge.hear(bridge.west, "r/*")
    for k in range(200):
        bridge.west.client.put("s/k", str(k), congestion_control=zenoh.CongestionControl.BLOCK)
        bridge.east.client.put("r/k", str(k), congestion_control=zenoh.CongestionControl.BLOCK)
    assert soon(lambda: len(heard) >= 200 and len(back) >= 200)
    time.sleep(0.2)
    for samples in (heard, back):
        assert [sample.payload.to_string() for sample in samples] == [str(k) for k in range(200)]


def test_control_keys_do_not_cross(bridge: Bridge) -> None:
    heard = bridge.hear(bridge.east, "s/@tis/end")
    bridge.west.client.put("s/@tis/end", b"x")
    bridge.west.client.put("s/a", b"x")
    assert soon(lambda: bool(bridge.arrivals))
    time.sleep(0.1)
    assert [arrival.key for arrival in bridge.arrivals] == ["s/a"]
    assert heard == []


def test_an_own_message_is_stamped_when_it_is_sent_and_says_what_it_is() -> None:
    """The surgeon's bus: header with the send time, JSON, real-time priority, dropped rather than waited for."""
    with a_network() as network:
        clock = WallClock(time.monotonic_ns())
        bus = ZenohBus({"west": network.client}, clock, Inbox())
        heard: list[zenoh.Sample] = []
        _held = network.router.declare_subscriber("t/key", heard.append)
        emission = Emission("west", "t/key", b'{"x": 1}', Header(7), lambda _: ())
        assert soon(lambda: bool(bus.send(0, emission) and heard))
        before_ns = clock.now_ns()
        sent_ns = bus.send(0, emission)
        assert before_ns <= sent_ns <= clock.now_ns()
        assert soon(lambda: any(_header(sample) == Header(7, sent_ns) for sample in heard))
        sample = heard[-1]
        assert sample.payload.to_bytes() == b'{"x": 1}'
        assert sample.encoding == zenoh.Encoding.APPLICATION_JSON
        passport = passport_of(sample)
        assert (passport.deletes, passport.priority, passport.express) == (False, zenoh.Priority.REAL_TIME, True)
        assert passport.congestion_control == zenoh.CongestionControl.DROP


def test_a_side_gets_bytes_stamped_on_arrival_and_not_its_own_messages() -> None:
    with a_network() as network:
        clock = WallClock(time.monotonic_ns())
        inbox: Inbox[zenoh.Sample] = Inbox()
        bus = ZenohBus({"east": network.client}, clock, inbox)
        bus.listen(Ears(("east", "t/key")))
        inbox.start(clock)
        time.sleep(0.1)
        bus.send(0, Emission("east", "t/key", b"own", Header(1), lambda _: ()))
        network.router.put("t/key", b"other", attachment=b"a")
        network.router.put("t/key", b"bare")
        before_ns = clock.now_ns()
        first = bus.wait(before_ns + _LIMIT_NS)
        second = bus.wait(before_ns + _LIMIT_NS)
        assert first is not None
        assert second is not None
        assert (first.arrival.payload, first.arrival.attachment) == (b"other", b"a")
        assert (second.arrival.payload, second.arrival.attachment) == (b"bare", b"")
        assert first.arrival.passport is None
        assert 0 < first.arrival.recv_ns <= second.arrival.recv_ns <= clock.now_ns()
        assert bus.wait(clock.now_ns() + 50_000_000) is None


def _header(sample: zenoh.Sample) -> Header | None:
    return None if sample.attachment is None else Header.unpack(sample.attachment.to_bytes())
