"""The bus of surgeon and patient on a real network."""

import time
from collections.abc import Sequence

import pytest
import zenoh

from tests.common.runtime.live_zenoh import a_network, settle, soon
from tis.common.channels import Network
from tis.common.messages import Header
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.runtime.clock import WallClock
from tis.common.runtime.loop import Delivery
from tis.common.runtime.zenoh_bus import Inbox, ZenohBus

pytestmark = pytest.mark.live
_LIMIT_NS = 30_000_000_000


class Ears:
    """A node that only listens."""

    name = "ears"

    def __init__(self, *keys: tuple[Network, str]) -> None:
        self.keys = keys

    def listens(self) -> Sequence[tuple[Network, str]]:
        return self.keys

    def publishes(self) -> Sequence[tuple[Network, str]]:
        return ()

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
        assert (sample.kind, sample.express) == (zenoh.SampleKind.PUT, False)
        assert sample.priority == zenoh.Priority.REAL_TIME
        assert sample.congestion_control == zenoh.CongestionControl.DROP


def test_a_side_gets_bytes_stamped_on_arrival_and_not_its_own_messages() -> None:
    with a_network() as network:
        clock = WallClock(time.monotonic_ns())
        inbox: Inbox[zenoh.Sample] = Inbox()
        bus = ZenohBus({"east": network.client}, clock, inbox)
        bus.listen(Ears(("east", "t/key")))
        inbox.start(clock)
        settle(network.client)
        bus.send(0, Emission("east", "t/key", b"own", Header(1), lambda _: ()))
        wait = zenoh.CongestionControl.BLOCK  # what is tested here is the side, not the router
        network.router.put("t/key", b"other", attachment=b"a", congestion_control=wait)
        network.router.put("t/key", b"bare", congestion_control=wait)
        before_ns = clock.now_ns()
        first = _next_arrival(bus, before_ns + _LIMIT_NS)
        second = _next_arrival(bus, before_ns + _LIMIT_NS)
        assert first is not None
        assert second is not None
        assert (first.arrival.payload, first.arrival.attachment) == (b"other", b"a")
        assert (second.arrival.payload, second.arrival.attachment) == (b"bare", b"")
        assert 0 < first.arrival.recv_ns <= second.arrival.recv_ns <= clock.now_ns()
        assert bus.wait(clock.now_ns() + 50_000_000) is None


def _next_arrival(bus: ZenohBus, deadline_ns: int) -> Delivery | None:
    """Wait as the loop does: a wait may end early, on the ring of an arrival that was already returned."""
    while (delivery := bus.wait(deadline_ns)) is None and bus.clock.now_ns() < deadline_ns:
        pass
    return delivery


def _header(sample: zenoh.Sample) -> Header | None:
    return None if sample.attachment is None else Header.unpack(sample.attachment.to_bytes())
