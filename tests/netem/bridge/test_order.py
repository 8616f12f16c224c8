"""Packets of one key leave in order, also where the release thread is late and a callback comes first."""

import threading
from collections.abc import Callable, Iterable
from typing import Any, Final

from tests.netem.making import KEY, link
from tis.common.node import Record
from tis.common.runtime.clock import Clock
from tis.netem.bridge.alarm import Alarm
from tis.netem.bridge.bridge import Bridge
from tis.netem.link.packet import Packet

MS: Final = 1_000_000
_PATIENCE_S: Final = 0.3


class Stopped:
    """A clock that stands where it is set."""

    def __init__(self) -> None:
        self.at_ns = 0

    def now_ns(self) -> int:
        return self.at_ns


class Nowhere:
    """What takes no notes."""

    def record(self, record: Record) -> None:
        pass

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        pass


class Sent:
    """Notes that it was sent; ``waits_for``: not until that has happened, as in a thread that is preempted."""

    def __init__(self, name: str, sent: list[str], waits_for: threading.Event | None = None) -> None:
        self.name, self.sent, self.waits_for = name, sent, waits_for
        self.left = threading.Event()

    def forward(self, packet: Packet) -> None:
        if self.waits_for is not None:
            self.waits_for.wait(_PATIENCE_S)
        self.sent.append(self.name)
        self.left.set()

    def drop(self) -> None:
        raise AssertionError("nothing is dropped here")


def test_a_callback_that_finds_an_overdue_packet_lets_none_overtake_it() -> None:
    """The first is due at 5 ms; at 6 ms, before the release thread has come, the second is offered, due at 11 ms."""
    sessions: Any = {"west": None, "east": None}
    bridge = Bridge(sessions, {"forward": link(forward={"delay": {"kind": "constant", "delay_ms": 5}})})
    clock, sent = Stopped(), list[str]()
    bridge.start(clock)
    second = Sent("second", sent)
    first = Sent("first", sent, waits_for=second.left)
    bridge.offer("forward", KEY, b"", 10, first)
    clock.at_ns = 6 * MS
    callback = threading.Thread(target=bridge.offer, args=("forward", KEY, b"", 10, second))
    callback.start()
    callback.join(_PATIENCE_S / 3)
    clock.at_ns = 12 * MS
    bridge.run(Nowhere(), 60_000 * MS, lambda: len(sent) == 2)
    callback.join()
    assert sent == ["first", "second"]


def test_what_is_not_delayed_leaves_from_the_callback_that_brings_it() -> None:
    bridge = Bridge({"west": None, "east": None}, {"forward": link()})  # type: ignore[dict-item]
    sent = list[str]()
    bridge.start(Stopped())
    bridge.offer("forward", KEY, b"", 10, Sent("at once", sent))
    assert sent == ["at once"]


class Rung(Alarm):
    """An alarm that must have rung before anybody sleeps."""

    def __init__(self, is_over: Callable[[], bool]) -> None:
        super().__init__()
        self.has_rung = False
        self._is_over = is_over

    def ring(self) -> None:
        self.has_rung = True

    def sleep(self, clock: Clock, until_ns: int) -> None:
        assert self.has_rung or self._is_over(), (
            "the release thread sleeps, and does not know of the packet that is due"
        )
        self.has_rung = False


def test_a_packet_that_is_offered_while_another_is_sent_rings_the_release_thread() -> None:
    """The second is offered at 6 ms, while the first is sent, and due at 11 ms."""
    sessions: Any = {"west": None, "east": None}
    bridge = Bridge(sessions, {"forward": link(forward={"delay": {"kind": "constant", "delay_ms": 5}})})
    clock, sent = Stopped(), list[str]()
    alarm = Rung(lambda: len(sent) == 2)
    bridge.alarm = alarm  # type: ignore[misc]
    bridge.start(clock)

    class Opening(Sent):
        def forward(self, packet: Packet) -> None:
            super().forward(packet)
            bridge.offer("forward", KEY, b"", 10, Sent("second", sent))
            clock.at_ns = 11 * MS

    bridge.offer("forward", KEY, b"", 10, Opening("first", sent))
    alarm.has_rung = False
    clock.at_ns = 6 * MS
    bridge.run(Nowhere(), 60_000 * MS, lambda: len(sent) == 2)
    assert sent == ["first", "second"]
