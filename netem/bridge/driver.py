"""The driver of two links in real time: packets are offered by callbacks and leave at their release instants.

Packets that are not delayed leave from the callback that offers them, which saves a change of threads. One thread
sends the others at their release instants, for which it sleeps until shortly before one and then polls the clock. The
driver of the same links in virtual time is `tis.netem.node`.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, ParamSpec, TypeVar

from tis.common.channels import Direction
from tis.common.node import Record
from tis.common.runtime.clock import Clock
from tis.common.runtime.loop import LateRecorder
from tis.common.runtime.scheduling import let_zenoh_wait, settle, sharpen_timers
from tis.netem.bridge.alarm import Alarm, measure_lead_ns
from tis.netem.bridge.gate import Gate, Visit
from tis.netem.bridge.standstill import Pulse
from tis.netem.link.ledger import last_records
from tis.netem.link.link import Link
from tis.netem.link.packet import Fate, Packet
from tis.netem.link.queue.lines import DATA

P = ParamSpec("P")
T = TypeVar("T")

_NEVER_NS: Final = 1 << 62
_IDLE_NS: Final = 2_000_000
_AHEAD_NS: Final = 20_000  # packets are taken from the link this early, so that the search does not delay them
_LOOK_NS: Final = 1_000_000  # between two looks whether a batch is full
_LAST_SENDS_S: Final = 0.5
_SEND_S: Final = 0.001

HELD_BACK: Final = Fate(-1, "queue_full")
"""What `Driver.offer` returns for a packet that waits for room in a queue."""


class Driver:
    """Two links in real time. Nothing passes before `start`; earlier packets are counted.

    ``error`` keeps an exception of a callback; it ends `run`.
    """

    def __init__(self, links: Mapping[Direction, Link]) -> None:
        self.links: Final = links
        self.alarm: Final = Alarm()
        self.pulse: Final = Pulse("the thread that releases messages")
        self.also_counts: Final[list[Callable[[], dict[str, int]]]] = []
        self.gates: Mapping[Direction, Gate] = {}
        """Where senders are held back."""
        self.n_early = 0
        self.error: BaseException | None = None
        self._lock = threading.Lock()  # guards the links and their ledgers; never held while a packet is sent
        self._clock: Clock | None = None
        self._has_ended = False
        self._sleeps_until_ns = 0
        self._busy = False  # the release thread sends: no callback may overtake it
        self._n_leaving = 0  # packets that callbacks are sending now
        self._records: list[Record] = []

    def settle(self, privileged: bool = True) -> None:
        """Tune this process for punctual releases, by `scheduling.settle`; it comes before `start`."""
        settle(privileged)
        let_zenoh_wait()
        self.alarm.lead_ns = measure_lead_ns()

    def start(self, clock: Clock) -> None:
        """Begin to accept packets."""
        self._clock = clock

    def wake(self) -> None:
        """End the release thread's sleep; safe from callbacks and signal handlers."""
        self.alarm.ring()

    def offer_in_turn(
        self, direction: Direction, name: str, attachment: bytes, n_bytes: int, item: Any, priority: int
    ) -> None:
        """Offer a packet once the queue that it joins has room: the calling thread waits at the gate."""
        gate = self.gates[direction]
        with self._lock:
            visit = gate.visit(priority)
        try:
            while self.offer(direction, name, attachment, n_bytes, item, priority, visit) is HELD_BACK:
                visit.wait()
        finally:
            with self._lock:
                gate.leave(visit)

    def offer(
        self, direction: Direction, name: str, attachment: bytes, n_bytes: int, item: Any, priority: int = DATA,
        visit: Visit | None = None,
    ) -> Fate | None:  # fmt: skip
        """Offer a packet to a link now, and send it at once unless it has to wait.

        ``item`` has ``forward(due)`` and ``drop()``, of which one is called for each copy that leaves. Returns None
        before `start` and after the end, when nothing passes, and `HELD_BACK` where its ``visit`` at the gate has to
        go on: it is not offered then.
        """
        link = self.links[direction]
        due: list[Packet] = []
        # Stage 1, under the lock: the decision, and who sends the packet.
        with self._lock:
            clock = self._clock
            now_ns = -1 if clock is None else clock.now_ns()
            if now_ns < 0:
                self.n_early += not self._has_ended
                return None
            first_ns = link.next_release_ns()
            if visit is not None:
                door = link.door(name, n_bytes + len(attachment), now_ns)
                if self.gates[direction].must_wait(visit, door, now_ns):
                    return HELD_BACK
            fate = link.offer(name, attachment, n_bytes, now_ns, item, priority)
            release_ns = fate.release_ns
            if release_ns is not None and release_ns > now_ns and link.is_plain and not fate.n_copies:
                wakes = release_ns < self._sleeps_until_ns  # the usual case: it only waits
            elif fate.outcome == "deliver":
                due, wakes = self._due_now(link, first_ns, now_ns)
                self._n_leaving += bool(due)
            else:
                wakes = self._sleeps_too_long(link)  # others may have been evicted for it
        # Stage 2, without the lock: waking the release thread, and sending, which may block.
        if wakes:
            self.wake()
        if due:
            left_ns = [self._forward(direction, one) for one in due]
            # Stage 3: the record, after the packet has left.
            with self._lock:
                for one, released_ns in zip(due, left_ns, strict=True):
                    link.left(one, released_ns)
                self._n_leaving -= 1
        elif fate.outcome == "deliver":
            self._kept(direction, item)
        return fate

    def _due_now(self, link: Link, first_ns: int | None, now_ns: int) -> tuple[list[Packet], bool]:
        """Return the packets to be sent at once after an offer, and whether to wake the release thread.

        ``first_ns`` was the next release before the offer.
        """
        link.note_queue_depth(now_ns)
        next_ns = link.next_release_ns()
        # overdue packets are left to the release thread: with two senders, packets could change places
        overdue = first_ns is not None and first_ns <= now_ns
        if next_ns is None or next_ns > now_ns or self._busy or overdue:
            return [], self._sleeps_too_long(link)
        # what has just passed a queue, a copy or what took an evicted packet's place may be due next
        return link.release(now_ns), self._sleeps_too_long(link)

    def _sleeps_too_long(self, link: Link) -> bool:
        """Tell whether a link has something to do before the release thread wakes by itself."""
        next_ns = link.next_release_ns()
        return next_ns is not None and next_ns < self._sleeps_until_ns

    @property
    def is_running(self) -> bool:
        """Tell whether packets are accepted now."""
        clock = self._clock
        return clock is not None and clock.now_ns() >= 0

    def intervene(self, act: Callable[[int], tuple[T, Sequence[Record]]]) -> T | None:
        """Call ``act`` between two packets, at one instant; return its answer, or None while nothing passes.

        ``act`` gets the run time in ns and returns an answer and records for the log.
        """
        with self._lock:
            clock = self._clock
            now_ns = -1 if clock is None else clock.now_ns()
            if now_ns < 0:
                return None
            answer, records = act(now_ns)
            self._records.extend(records)
            wakes = any(map(self._sleeps_too_long, self.links.values()))
        if wakes:  # a queue is served faster, or a stall ends
            self.wake()
        return answer

    def in_outage(self, direction: Direction) -> bool:
        """Tell whether the link has an outage now; False before `start`."""
        with self._lock:
            clock = self._clock
            return clock is not None and self.links[direction].conditions.at(clock.now_ns()).outage

    def failed(self, error: BaseException) -> None:
        """Keep the exception of a callback, and end `run`."""
        self.error = error
        self.wake()

    def guarded(self, callback: Callable[P, None]) -> Callable[P, None]:
        """Return a callback whose exception is kept: Zenoh would swallow it."""

        def call(*args: P.args, **named: P.kwargs) -> None:
            try:
                callback(*args, **named)
            except BaseException as error:
                self.failed(error)

        return call

    def run(self, recorder: LateRecorder, until_ns: int, stopped: Callable[[], bool]) -> None:
        """Release packets at their instants until run time ``until_ns`` or until ``stopped``; then end the log."""
        clock = self._clock
        assert clock is not None, "start() comes before run()"
        sharpen_timers()
        self.pulse.is_busy = True  # it sleeps for half a second at most
        look_ns = 0
        while not stopped() and self.error is None:
            self.pulse.n += 1
            now_ns = clock.now_ns()
            if now_ns >= until_ns:
                break
            next_ns = min(self._release(clock) - _AHEAD_NS, until_ns)
            if next_ns <= now_ns:
                continue
            if now_ns >= look_ns:
                self._close_batches(recorder, now_ns)
                look_ns = now_ns + _LOOK_NS
            if next_ns - now_ns <= _IDLE_NS or not self._run_deferred():
                self.alarm.sleep(clock, next_ns)
        self.pulse.is_busy = False
        self._stop_accepting()
        with self._lock:
            ledgers = (link.ledger for link in self.links.values())
            for record in (*self._records, *last_records(ledgers, self.counters(), clock.now_ns())):
                recorder.record(record)

    def counters(self) -> dict[str, int]:
        """Return the counts, by name."""
        counts = {name: n for link in self.links.values() for name, n in link.counters().items()}
        counts |= {"before_epoch": self.n_early, "lead_ns": self.alarm.lead_ns}
        counts |= {f"{direction}.held_back": gate.n_held_back for direction, gate in self.gates.items()}
        counts |= {f"{direction}.held_back_overdue": gate.n_overdue for direction, gate in self.gates.items()}
        return counts | {name: n for count in self.also_counts for name, n in count().items()}

    def _release(self, clock: Clock) -> int:
        """Send the due packets; return the instant of the next release, which may have passed meanwhile."""
        due: list[tuple[Link, list[Packet]]] = []
        with self._lock:
            now_ns, next_ns = clock.now_ns(), _NEVER_NS
            for link in self.links.values():
                link_ns = link.next_release_ns()
                # a queue must not advance into the future: a later offer may still change it
                until_ns = now_ns if link.has_queues else now_ns + _AHEAD_NS
                if link_ns is not None and link_ns <= until_ns:
                    due.append((link, link.release(until_ns)))
                    link_ns = link.next_release_ns()
                if link_ns is not None and link_ns < next_ns:
                    next_ns = link_ns
            # an earlier packet that is offered from now on rings the alarm, also while this thread sends
            self._sleeps_until_ns = next_ns
            self._busy = bool(due)
            for gate in self.gates.values():
                gate.ring()
        # while _busy is set, callbacks leave sending and recording of departures to this thread
        for link, packets in due:
            for one in packets:
                link.left(one, self._forward(link.direction, one))
        self._busy = False
        return next_ns

    def _forward(self, direction: Direction, packet: Packet) -> int:
        """Send a packet, or drop it; return the run time at which it left."""
        clock = self._clock
        released_ns = 0 if clock is None else clock.now_ns()
        if packet.release_ns is not None and clock is not None:
            while released_ns < packet.release_ns:  # never early; this polls for _AHEAD_NS at most
                released_ns = clock.now_ns()
        self._send(direction, packet)
        return released_ns

    def _send(self, direction: Direction, packet: Packet) -> None:  # noqa: ARG002
        """Send a packet that leaves, or drop it."""
        if packet.departure == "released":
            packet.item.forward(packet)
        else:
            packet.item.drop()

    def _kept(self, direction: Direction, item: Any) -> None:
        """Do what an item needs that has to wait."""

    def _run_deferred(self) -> bool:
        """Draw one block ahead of its use; False: there is none."""
        link = next((link for link in self.links.values() if link.deferred), None)
        if link is not None:
            with self._lock:
                link.run_deferred(1)
        return link is not None

    def _stop_accepting(self) -> None:
        """Let nothing pass any longer, and wait for the packets that callbacks are sending."""
        with self._lock:
            self._clock, self._has_ended = None, True
        patience = _LAST_SENDS_S / _SEND_S
        while self._n_leaving and patience > 0:
            time.sleep(_SEND_S)
            patience -= 1

    def _close_batches(self, recorder: LateRecorder, now_ns: int) -> None:
        while self._records:
            recorder.record(self._records.pop(0))
        for link in self.links.values():
            if link.ledger.is_full(now_ns):
                with self._lock:
                    make = link.ledger.close(now_ns)
                    link.conditions.prepare(now_ns)
                recorder.record_later(make)
