"""netem between two real networks: what goes in on one side comes out on the other, untouched, once."""

import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any

import pytest
import zenoh

from tests.common.runtime.live_zenoh import Network, a_network, settle, soon
from tis.common.node import Record
from tis.common.records import FateBatch, ReleaseBatch
from tis.common.runtime.clock import WallClock
from tis.common.scenario.network import NetworkPart
from tis.netem.bridge.bridge import Bridge
from tis.netem.build import build_links

pytestmark = pytest.mark.live


@dataclass
class Book:
    """A recorder that keeps what was recorded."""

    records: list[Any] = field(default_factory=list)

    def record(self, record: Record) -> None:
        self.records.append(record.data)

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        for record in make():
            self.record(record)


@dataclass
class Crossing:
    """Two networks with netem between them."""

    west: Network
    east: Network
    bridge: Bridge
    book: Book = field(default_factory=Book)
    stopped: threading.Event = field(default_factory=threading.Event)
    _held: list[object] = field(default_factory=list)

    def hear(self, network: Network, key: str = "**") -> list[zenoh.Sample]:
        heard: list[zenoh.Sample] = []
        self._held.append(network.client.declare_subscriber(key, heard.append))
        settle(network.client)
        return heard

    def offered(self) -> int:
        return sum(link.offered for link in self.bridge.links.values())


def _crossing(stack: ExitStack, **network: Any) -> Crossing:
    west, east = stack.enter_context(a_network()), stack.enter_context(a_network())
    links = build_links(NetworkPart.model_validate(network), ["**"], 1, None, "test")
    bridge = Bridge({"west": west.router, "east": east.router}, links)
    bridge.subscribe("forward", "**")
    bridge.subscribe("feedback", "**")
    found = Crossing(west, east, bridge)
    bridge.start(WallClock(time.monotonic_ns()))
    thread = threading.Thread(target=bridge.run, args=(found.book, 1 << 62, found.stopped.is_set), daemon=True)
    thread.start()

    def end() -> None:
        found.stopped.set()
        bridge.wake()
        thread.join(5)
        bridge.close()
        assert bridge.error is None

    stack.callback(end)
    return found


@pytest.fixture
def crossing() -> Iterator[Crossing]:
    with ExitStack() as stack:
        yield _crossing(stack)


@pytest.mark.parametrize("direction", ["west to east", "east to west"])
def test_all_that_a_sample_carries_crosses_unchanged_and_once(crossing: Crossing, direction: str) -> None:
    here, there = (crossing.west, crossing.east) if direction == "west to east" else (crossing.east, crossing.west)
    heard, echoes = crossing.hear(there), crossing.hear(here)
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
    assert crossing.offered() == 1
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


def test_a_delete_crosses_as_a_delete(crossing: Crossing) -> None:
    heard = crossing.hear(crossing.east)
    crossing.west.client.delete(
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


def test_what_a_sample_lacks_it_lacks_on_the_other_side_too(crossing: Crossing) -> None:
    """No attachment does not become an empty one; an empty payload stays empty."""
    heard = crossing.hear(crossing.east)
    crossing.west.client.put("s/a/b", b"")
    assert soon(lambda: bool(heard))
    assert heard[0].attachment is None
    assert heard[0].payload.to_bytes() == b""
    assert heard[0].encoding == zenoh.Encoding.ZENOH_BYTES


def test_many_messages_cross_in_order_and_none_twice(crossing: Crossing) -> None:
    heard = crossing.hear(crossing.east, "s/*")
    back = crossing.hear(crossing.west, "r/*")
    for k in range(200):
        crossing.west.client.put("s/k", str(k), congestion_control=zenoh.CongestionControl.BLOCK)
        crossing.east.client.put("r/k", str(k), congestion_control=zenoh.CongestionControl.BLOCK)
    assert soon(lambda: len(heard) >= 200 and len(back) >= 200)
    time.sleep(0.2)
    for samples in (heard, back):
        assert [sample.payload.to_string() for sample in samples] == [str(k) for k in range(200)]


def test_control_keys_do_not_cross(crossing: Crossing) -> None:
    heard = crossing.hear(crossing.east, "s/@tis/end")
    crossing.west.client.put("s/@tis/end", b"x")
    crossing.west.client.put("s/a", b"x")
    assert soon(lambda: crossing.offered() > 0)
    time.sleep(0.1)
    assert crossing.offered() == 1
    assert heard == []


def test_delayed_messages_leave_at_their_instants_and_the_books_balance() -> None:
    pipeline = {
        "loss": {"kind": "burst", "p_loss": 0.2, "mean_burst": 2},
        "duplicate": {"p_duplicate": 0.1},
        "delay": {"kind": "uniform", "low_ms": 20, "high_ms": 60},
        "ordering": "reorder",
    }
    with ExitStack() as stack:
        crossing = _crossing(stack, forward=pipeline)
        heard = crossing.hear(crossing.east, "s/*")
        n = 300
        for k in range(n):
            crossing.west.client.put(f"s/{k % 3}", str(k), congestion_control=zenoh.CongestionControl.BLOCK)
        link = crossing.bridge.links["forward"]
        assert soon(lambda: link.offered == n and link.held == 0)
        assert soon(lambda: len(heard) == link.released)
    fates = [batch for batch in crossing.book.records if isinstance(batch, FateBatch)]
    releases = [batch for batch in crossing.book.records if isinstance(batch, ReleaseBatch)]
    assert sum(len(batch.seq) for batch in fates) == n
    decided = {
        (batch.key, seq): (outcome, release_ns)
        for batch in fates
        for seq, outcome, release_ns in zip(batch.seq, batch.outcome, batch.release_ns, strict=True)
    }
    lost = sum(outcome == "loss" for outcome, _ in decided.values())
    copies = sum(sum(batch.copies) for batch in fates)
    left = [
        (batch.key, *row)
        for batch in releases
        for row in zip(batch.seq, batch.copy_index, batch.release_ns, batch.released_ns, strict=True)
    ]
    assert 0 < lost < n
    assert copies > 0
    assert len(left) == n - lost + copies == len(heard)
    assert all(released_ns >= release_ns for *_, release_ns, released_ns in left)  # never early
    assert all(decided[key, seq][1] == release_ns for key, seq, copy, release_ns, _ in left if copy == 0)


def test_flipped_bits_arrive_flipped() -> None:
    with ExitStack() as stack:
        crossing = _crossing(stack, forward={"corrupt": {"p_corrupt": 1, "bits": 3}})
        heard = crossing.hear(crossing.east)
        crossing.west.client.put("s/a", bytes(32), attachment=b"whole")
        assert soon(lambda: bool(heard))
    assert sum(byte.bit_count() for byte in heard[0].payload.to_bytes()) == 3
    assert heard[0].attachment is not None
    assert heard[0].attachment.to_bytes() == b"whole"


@pytest.mark.parametrize("epoch_is_known", [False, True])
def test_nothing_passes_before_it_begins(epoch_is_known: bool) -> None:
    """The epoch is announced ahead of its instant."""
    with a_network() as west, a_network() as east:
        links = build_links(NetworkPart(), ["**"], 1, None, "test")
        links["forward"].prepare(["s/a"])  # as if a message had come already
        bridge = Bridge({"west": west.router, "east": east.router}, links)
        if epoch_is_known:
            bridge.start(WallClock(time.monotonic_ns() + 3600 * 10**9))
        bridge.subscribe("forward", "**")
        heard: list[zenoh.Sample] = []
        with east.client.declare_subscriber("**", heard.append):
            assert soon(lambda: bool(west.client.put("s/a", b"x") or bridge.n_early))
        bridge.close()
        assert heard == []
        assert links["forward"].offered == 0
