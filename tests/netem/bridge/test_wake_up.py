"""The release thread is woken for whatever becomes due before the instant until which it sleeps.

The thread is the real one, `Driver.run`; its sleep passes in virtual time, in which the next offers come.
"""

from collections.abc import Callable, Iterable
from typing import Any, Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.netem.making import KEY, link
from tis.common.channels import Direction
from tis.common.node import Record
from tis.common.scenario.network.conditions import TimelineEntry
from tis.netem.bridge.driver import Driver
from tis.netem.control.replay import apply_entries
from tis.netem.link.packet import Packet

MS: Final = 1_000_000
_TICK_NS: Final = 1_000
_MAX_LATE_NS: Final = 300_000  # some readings of the clock
_END_NS: Final = 60_000 * MS
_CONSTANT: Final = {"kind": "constant", "delay_ms": 40}
_RANDOM: Final = {"kind": "uniform", "low_ms": 0, "high_ms": 40}
_CROSS: Final = {"kind": "poisson", "kbit_s": 200, "message_bytes": 500}
_NETWORKS: Final[dict[str, dict[str, Any]]] = {
    "rate": {"delay": _CONSTANT, "rate": {"kbit_s": 5000}},
    "slow rate": {"delay": _CONSTANT, "rate": {"kbit_s": 50}},
    "rate, any order": {"delay": _RANDOM, "rate": {"kbit_s": 5000}, "ordering": "reorder"},
    "codel": {"delay": _CONSTANT, "rate": {"kbit_s": 50, "queue": {"kind": "codel"}}},
    "priority": {"delay": _CONSTANT, "rate": {"kbit_s": 50, "queue": {"kind": "priority", "max_packets": 2}}},
    "traffic of others": {"delay": _CONSTANT, "rate": {"kbit_s": 500, "cross": _CROSS}},
    "copies": {"delay": _RANDOM, "ordering": "reorder", "duplicate": {"p_duplicate": 0.5}},
    "recovery": {"delay": _CONSTANT, "loss": {"kind": "bernoulli", "p_loss": 0.3, "recovery": {}}},
    "delay": {"delay": _RANDOM},
}  # fmt: skip


class Ticking:
    """A clock that goes on by a microsecond with each reading."""

    def __init__(self) -> None:
        self.at_ns = 0

    def now_ns(self) -> int:
        self.at_ns += _TICK_NS
        return self.at_ns


class VirtualAlarm:
    """An alarm whose sleep passes at once: what happens meanwhile is done in it, until one of it rings."""

    def __init__(self) -> None:
        self.lead_ns = 0
        self.happens: list[tuple[int, Callable[[], object]]] = []
        self._rings = False

    def ring(self) -> None:
        self._rings = True

    def sleep(self, clock: Ticking, until_ns: int) -> None:
        while not self._rings and self.happens and self.happens[0][0] <= until_ns:
            at_ns, do = self.happens.pop(0)
            clock.at_ns = max(clock.at_ns, at_ns)
            do()
        if not self._rings:
            clock.at_ns = max(clock.at_ns, until_ns)
        self._rings = False


class Nowhere:
    """What takes no notes."""

    def record(self, record: Record) -> None:
        pass

    def record_later(self, make: Callable[[], Iterable[Record]]) -> None:
        pass


class Timed:
    """A packet that notes when it left, and when it should have."""

    def __init__(self, clock: Ticking, left: list[tuple[int, int]]) -> None:
        self._clock, self._left = clock, left

    def forward(self, packet: Packet) -> None:
        self._left.append((packet.release_ns or 0, self._clock.at_ns))

    def drop(self) -> None:
        """Not of interest."""


def _late_ns(
    offers: Iterable[tuple[int, int]], direction: Direction = "forward", changes: Iterable[tuple[int, float]] = (),
    **network: Any,
) -> list[int]:  # fmt: skip
    """Return how late each packet of ``offers`` (ms, bytes) left; ``changes`` are rates (ms, kbit/s) asked for."""
    clock, left = Ticking(), list[tuple[int, int]]()
    driver = Driver({direction: link(direction, **network)})
    alarm = VirtualAlarm()
    driver.alarm = alarm  # type: ignore[misc, assignment]
    for at_ms, n_bytes in offers:
        offer = lambda n_bytes=n_bytes: driver.offer(direction, KEY, b"", n_bytes, Timed(clock, left))  # noqa: E731
        alarm.happens.append((at_ms * MS, offer))
    for at_ms, kbit_s in changes:
        entry = TimelineEntry.model_validate({"at_s": at_ms / 1000, "set": {"rate": {"kbit_s": kbit_s}}})
        change = lambda entry=entry: driver.intervene(  # noqa: E731
            lambda now_ns: (apply_entries(driver.links, [entry], False, now_ns), ())
        )
        alarm.happens.append(((at_ms - 1) * MS, change))
    alarm.happens.sort(key=lambda one: one[0])
    driver.start(clock)
    driver.run(Nowhere(), _END_NS, lambda: not alarm.happens and not driver.links[direction].held)
    assert left
    return [left_ns - due_ns for due_ns, left_ns in left]


def test_what_comes_after_the_end_did_not_come_before_the_beginning() -> None:
    driver, clock = Driver({"forward": link("forward")}), Ticking()
    driver.alarm = VirtualAlarm()  # type: ignore[misc, assignment]
    assert driver.offer("forward", KEY, b"", 10, Timed(clock, [])) is None
    driver.start(clock)
    driver.run(Nowhere(), 10 * MS, lambda: False)
    assert driver.offer("forward", KEY, b"", 10, Timed(clock, [])) is None
    assert driver.counters()["before_epoch"] == 1


@pytest.mark.parametrize("direction", ["forward", "feedback"])
def test_a_message_without_bytes_behind_a_rate_leaves_after_its_delay(direction: Direction) -> None:
    """A query without parameters, the end of its replies and a token have none: they pass the queue in no time."""
    network: dict[str, Any] = {direction: _NETWORKS["rate"]}
    (late_ns,) = _late_ns([(5, 0)], direction, **network)
    assert late_ns < _MAX_LATE_NS


def test_a_copy_leaves_after_its_own_delay_where_the_first_leaves_at_once() -> None:
    network = {
        "delay": _CONSTANT,
        "reorder": {"p_reorder": 0.5},
        "ordering": "reorder",
        "duplicate": {"p_duplicate": 1},
    }
    assert max(_late_ns([(500 * n, 10) for n in range(20)], forward=network)) < _MAX_LATE_NS


def test_what_gets_the_place_of_an_evicted_message_leaves_after_its_own_delay() -> None:
    network = {"delay": _RANDOM, "ordering": "reorder"}
    buffer = {"max_packets": 1, "policy": "drop_oldest"}
    assert (
        max(_late_ns([(500 * n + m, 10) for n in range(20) for m in (0, 1)], forward=network, buffer=buffer))
        < _MAX_LATE_NS
    )


def test_a_rate_asked_for_while_messages_wait_holds_from_its_instant() -> None:
    """100 bytes take 100 s at 8 bit/s, and 1 ms at 800 kbit/s from 20 ms on."""
    late_ns = _late_ns([(5, 100)], changes=[(20, 800)], forward={"rate": {"kbit_s": 0.008}})
    assert max(late_ns) < _MAX_LATE_NS


@pytest.mark.parametrize("name", _NETWORKS)
@settings(max_examples=40, deadline=None)
@given(offers=st.lists(st.tuples(st.integers(0, 200), st.sampled_from([0, 0, 1, 40, 1400])), min_size=1, max_size=12))
def test_no_message_waits_for_another_to_wake_the_thread(name: str, offers: list[tuple[int, int]]) -> None:
    assert max(_late_ns(sorted(offers), forward=_NETWORKS[name]), default=0) < _MAX_LATE_NS
