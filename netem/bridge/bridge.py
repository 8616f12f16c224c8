"""The emulator between two Zenoh networks, live: the loop of `common.runtime`, tightened for one purpose.

A packet is offered in the callback that brings it, which saves a change of threads; what is not delayed leaves from
there, too. One thread waits for releases (`netem.bridge.alarm`). In virtual time `netem.node` runs these links.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar

import zenoh

from common.channels import DESTINATION, ORIGIN, Direction, Network
from common.node import Record
from common.records import COUNTERS, CounterNote
from common.runtime.clock import Clock
from common.runtime.inbox import sharpen_timers
from common.runtime.loop import LateRecorder
from netem.bridge.alarm import Alarm
from netem.bridge.egress import Egress
from netem.bridge.keys import is_private
from netem.link.ledger import Ledger
from netem.link.link import Link
from netem.link.packet import Due, Fate
from netem.stages.corruption import flip_bits

T = TypeVar("T")

_NEVER_NS: Final = 1 << 62
_IDLE_NS: Final = 2_000_000
_AHEAD_NS: Final = 20_000  # packets are taken from the link a little early, so that finding them costs them nothing
_LAST_SENDS_S: Final = 0.5
_A_SEND_S: Final = 0.001


class Bridge:
    """Two links between two sessions. Nothing passes before `start`; what comes earlier is counted.

    ``error`` keeps what went wrong in a callback, where Zenoh would swallow it; it ends `run`.
    """

    def __init__(self, sessions: Mapping[Network, zenoh.Session], links: Mapping[Direction, Link]) -> None:
        self.links: Final = links
        self.ledgers: Final = {direction: Ledger(direction) for direction in links}
        self.alarm: Final = Alarm()
        self.also_counts: Final[list[Callable[[], dict[str, int]]]] = []
        self.base_overhead_ns = 0
        self.n_early = 0
        self.n_unsent = 0
        self.error: BaseException | None = None
        self._egress: Final = {way: Egress(sessions[DESTINATION[way]]) for way in links}
        self._lock = threading.Lock()
        self._clock: Clock | None = None
        self._sleeps_until_ns = 0
        self._busy = False
        self._n_leaving = 0
        self._sessions = sessions
        self._held: list[Any] = []
        self._records: list[Record] = []

    def subscribe(self, direction: Direction, key: str) -> None:
        """Let the messages that match ``key`` cross in ``direction``."""
        session = self._sessions[ORIGIN[direction]]
        self._held.append(
            session.declare_subscriber(key, self.receiver(direction), allowed_origin=zenoh.Locality.REMOTE)
        )

    def start(self, clock: Clock) -> None:
        """Begin to take packets in."""
        self._clock = clock

    def wake(self) -> None:
        """End the release thread's sleep; safe from callbacks and signal handlers."""
        self.alarm.ring()

    def receiver(self, direction: Direction) -> Callable[[zenoh.Sample], None]:
        """Return the callback for the messages of one direction."""

        def receive(sample: zenoh.Sample) -> None:
            try:
                key = str(sample.key_expr)
                if is_private(key):
                    return
                attached = sample.attachment
                attachment = b"" if attached is None else attached.to_bytes()
                n_bytes = len(sample.payload)
                if not self._cross(direction, key, attachment, n_bytes, sample):
                    self.offer(direction, key, attachment, n_bytes, sample)
            except BaseException as error:
                self.failed(error)

        return receive

    def offer(self, direction: Direction, name: str, attachment: bytes, n_bytes: int, item: Any) -> Fate | None:
        """Offer a packet to a link, now; one that need not wait leaves at once. None: nothing passes yet."""
        link, ledger = self.links[direction], self.ledgers[direction]
        due: list[Due] = []
        with self._lock:
            clock = self._clock
            now_ns = -1 if clock is None else clock.now_ns()
            if now_ns < 0:
                self.n_early += 1
                return None
            first_ns = link.next_release_ns()
            fate = link.offer(name, attachment, n_bytes, now_ns, item)
            ledger.decided(name, fate, now_ns, n_bytes)
            if fate.outcome != "deliver":
                return fate
            if link.has_queues:
                ledger.queue_depth(now_ns, *link.queue_depth())
            next_ns = link.next_release_ns()
            # what is overdue is left to the release thread: two threads that send could let packets change places
            overdue = first_ns is not None and first_ns <= now_ns
            if next_ns is None or next_ns > now_ns or self._busy or overdue:
                wakes = next_ns is not None and next_ns < self._sleeps_until_ns
            else:
                due, wakes = link.release(now_ns), False
            self._n_leaving += bool(due)
        if due:
            left_ns = [self._forward(direction, one) for one in due]
            with self._lock:
                for one, released_ns in zip(due, left_ns, strict=True):
                    ledger.left(one, released_ns)
                self._n_leaving -= 1
        elif wakes:
            self.wake()
        return fate

    def _cross(self, direction: Direction, key: str, attachment: bytes, n_bytes: int, sample: zenoh.Sample) -> bool:
        """Send a message on at once where nothing holds it back; the books come after, so that it need not wait."""
        link, ledger = self.links[direction], self.ledgers[direction]
        with self._lock:
            clock = self._clock
            now_ns = -1 if clock is None else clock.now_ns()
            if clock is None or self._busy or not link.lets_through(key, n_bytes + len(attachment), now_ns):
                return False
            self._n_leaving += 1
        released_ns = clock.now_ns()
        if not self._egress[direction].send(sample, key, sample.payload):
            self.n_unsent += 1
        with self._lock:
            ledger.crossed(key, *link.number(key, attachment), now_ns, released_ns, n_bytes)
            self._n_leaving -= 1
        return True

    @property
    def is_running(self) -> bool:
        """Tell whether packets are taken in now."""
        clock = self._clock
        return clock is not None and clock.now_ns() >= 0

    def intervene(self, act: Callable[[int], tuple[T, Sequence[Record]]]) -> T | None:
        """Do something to the links at one instant, between two packets; None: nothing passes yet, or any longer.

        ``act`` gets the run time in ns and returns an answer, which is returned, and what is to be logged.
        """
        with self._lock:
            clock = self._clock
            now_ns = -1 if clock is None else clock.now_ns()
            if now_ns < 0:
                return None
            answer, records = act(now_ns)
            self._records.extend(records)
            return answer

    def in_outage(self, direction: Direction) -> bool:
        """Tell whether the link has an outage now; not before `start`."""
        with self._lock:
            clock = self._clock
            return clock is not None and self.links[direction].conditions.at(clock.now_ns()).outage

    def failed(self, error: BaseException) -> None:
        """Keep what went wrong in a callback, and end `run`."""
        self.error = error
        self.wake()

    def run(self, recorder: LateRecorder, until_ns: int, stopped: Callable[[], bool]) -> None:
        """Release packets at their instants until run time ``until_ns``, or until ``stopped``; close the books."""
        assert self._clock is not None, "start() comes before run()"
        sharpen_timers()
        clock = self._clock
        while not stopped() and self.error is None:
            now_ns = clock.now_ns()
            if now_ns >= until_ns:
                break
            next_ns = min(self._release(clock) - _AHEAD_NS, until_ns)
            if next_ns <= now_ns:
                continue
            self._close_books(recorder, clock.now_ns())
            if next_ns - clock.now_ns() <= _IDLE_NS or not self._run_an_errand():
                self.alarm.sleep(clock, next_ns)
        self._stop_taking()
        with self._lock:
            for record in self._last_records(clock.now_ns()):
                recorder.record(record)

    def close(self) -> None:
        """Stop listening."""
        for declaration in self._held:
            declaration.undeclare()
        self._held.clear()

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name."""
        counts = {name: n for link in self.links.values() for name, n in link.counters().items()}
        counts |= {
            "unsent": self.n_unsent,
            "before_epoch": self.n_early,
            "lead_ns": self.alarm.lead_ns,
            "base_overhead_ns": self.base_overhead_ns,
        }
        return counts | {name: n for count in self.also_counts for name, n in count().items()}

    def _release(self, clock: Clock) -> int:
        """Send what is due; return when something is to be done next."""
        while True:
            due: list[tuple[Direction, list[Due]]] = []
            with self._lock:
                now_ns, next_ns = clock.now_ns(), _NEVER_NS
                for direction, link in self.links.items():
                    link_ns = link.next_release_ns()
                    # a queue must not be asked for what has not happened yet
                    until_ns = now_ns if link.has_queues else now_ns + _AHEAD_NS
                    if link_ns is not None and link_ns <= until_ns:
                        due.append((direction, link.release(until_ns)))
                    elif link_ns is not None:
                        next_ns = min(next_ns, link_ns)
                self._busy = bool(due)
                self._sleeps_until_ns = 0 if due else next_ns
            if not due:
                return next_ns
            for direction, packets in due:
                ledger = self.ledgers[direction]
                for one in packets:
                    ledger.left(one, self._forward(direction, one))

    def _forward(self, direction: Direction, due: Due) -> int:
        """Send a packet, or let go of it; return when it left, in run time."""
        clock = self._clock
        released_ns = 0 if clock is None else clock.now_ns()
        while released_ns < due.release_ns and clock is not None:  # never early; at most _AHEAD_NS
            released_ns = clock.now_ns()
        item = due.item
        if due.departure != "released":
            if not isinstance(item, zenoh.Sample):
                item.drop()
        elif not isinstance(item, zenoh.Sample):
            item.forward(due)
        elif not self._egress[direction].send(item, due.name, self._payload(direction, due)):
            self.n_unsent += 1
        return released_ns

    def _payload(self, direction: Direction, due: Due) -> zenoh.ZBytes:
        payload: zenoh.ZBytes = due.item.payload
        if not due.n_flips:
            return payload
        address = self.links[direction].address(due.name)
        return zenoh.ZBytes(flip_bits(payload.to_bytes(), due.seq, due.n_flips, address))

    def _run_an_errand(self) -> bool:
        """Draw a block that will soon be wanted; False: there is none."""
        for link in self.links.values():
            if link.errands:
                with self._lock:
                    link.run_errands(1)
                return True
        return False

    def _stop_taking(self) -> None:
        """Let nothing pass any longer, and wait for what callbacks are sending just now."""
        with self._lock:
            self._clock = None
        patience = _LAST_SENDS_S / _A_SEND_S
        while self._n_leaving and patience > 0:
            time.sleep(_A_SEND_S)
            patience -= 1

    def _close_books(self, recorder: LateRecorder, now_ns: int) -> None:
        while self._records:
            recorder.record(self._records.pop(0))
        for direction, ledger in self.ledgers.items():
            if ledger.is_full(now_ns):
                with self._lock:
                    make = ledger.close(now_ns)
                    self.links[direction].conditions.prepare(now_ns)
                recorder.record_later(make)

    def _last_records(self, now_ns: int) -> list[Record]:
        records = self._records + [one for ledger in self.ledgers.values() for one in ledger.close(now_ns)()]
        return records + [
            Record(COUNTERS, now_ns, CounterNote(name=name, value=value)) for name, value in self.counters().items()
        ]
