"""The server of a bit rate: messages of all its keys share one queue and are sent one after the other."""

from collections import deque
from typing import Any, NamedTuple

from common.scenario.network.capacity import CoDel as CoDelPart
from common.scenario.network.capacity import Rate
from netem.link.queue.codel import CoDel
from netem.link.queue.line import Line
from netem.link.queue.tail_drop import TailDrop


class Departed(NamedTuple):
    """A message whose last bit was sent at ``left_ns``, or which CoDel ``dropped`` then at the head of the queue."""

    item: Any
    offered_ns: int
    left_ns: int
    dropped: bool


class Server:
    """A first-come, first-served server at a bit rate, with a bounded queue that includes the message being sent.

    Instants must not decrease from call to call; an earlier one counts as the latest so far. The result depends on
    the offers alone, not on the calls of `depart` (oracles: a simulation of all arrivals at once, the
    Pollaczek-Khinchine formula; tests/netem/link/queue). At equal instants a transmission ends before a message is
    offered, which makes room for it.
    """

    def __init__(self, rate: Rate) -> None:
        self.rate: Rate | None = rate
        self.n_packets = 0
        """Messages in the queue, including the one being sent."""
        self.n_bytes = 0
        """Their bytes, including the overhead of each."""
        self._line = Line(rate.kbit_s)
        self._overhead_bytes = rate.overhead_bytes
        self._bounds = TailDrop.of(rate.queue)
        self._codel = _codel_of(rate)
        self._longest_bytes = 0
        # (item, bytes, offered_ns); the bytes include the overhead at the time of offering
        self._waiting: deque[tuple[Any, int, int]] = deque()
        self._sending: tuple[Any, int, int] | None = None
        self._departed: list[Departed] = []
        self._now_ns = 0

    def offer(self, item: Any, n_bytes: int, now_ns: int) -> bool:
        """Put a message of ``n_bytes`` (without overhead) into the queue; False if it is full."""
        now_ns = self._advance(now_ns)
        n_bytes += self._overhead_bytes
        if not self._bounds.admits(self.n_packets, self.n_bytes, n_bytes):
            return False
        self.n_packets += 1
        self.n_bytes += n_bytes
        if n_bytes > self._longest_bytes:
            self._longest_bytes = n_bytes
        if self._sending is None:
            self._sending = (item, n_bytes, now_ns)
            self._line.send(n_bytes, now_ns)
        else:
            self._waiting.append((item, n_bytes, now_ns))
        return True

    def next_departure_ns(self) -> int | None:
        """Return the next departure, unless the rate changes before it; None if the queue is empty."""
        if self._departed:
            return self._departed[0].left_ns
        return None if self._sending is None else self._line.free_ns

    def depart(self, now_ns: int) -> list[Departed]:
        """Return, in order, the messages sent or dropped until ``now_ns`` that were not returned before."""
        self._advance(now_ns)
        departed, self._departed = self._departed, []
        return departed

    def set_rate(self, rate: Rate | None, now_ns: int) -> None:
        """Change the rate at ``now_ns``, not before an earlier call's instant.

        Bits not yet sent take the new bit rate, also those of the message being sent; without a rate everything that
        waits leaves now. New bounds and a new overhead apply to later offers; no waiting message is dropped. CoDel
        restarts if its parameters differ.
        """
        now_ns = self._advance(now_ns)
        before, self.rate = self.rate, rate
        self._line.set_rate(None if rate is None else rate.kbit_s, now_ns)
        if rate is None:
            self._codel = None
            self._advance(now_ns)
            return
        self._overhead_bytes = rate.overhead_bytes
        self._bounds = TailDrop.of(rate.queue)
        if _control(rate) != _control(before):
            self._codel = _codel_of(rate)

    def _advance(self, now_ns: int) -> int:
        """Process all events until ``now_ns``; return the latest instant so far."""
        if now_ns < self._now_ns:
            now_ns = self._now_ns
        self._now_ns = now_ns
        while self._sending is not None and self._line.free_ns <= now_ns:
            left_ns = self._line.free_ns
            self._leave(self._sending, left_ns, dropped=False)
            self._sending = self._next(left_ns)
        return now_ns

    def _next(self, now_ns: int) -> tuple[Any, int, int] | None:
        """Begin to send the next message that is not dropped, and return it; None if the queue is empty."""
        codel = self._codel
        while self._waiting:
            head = self._waiting.popleft()
            _, n_bytes, offered_ns = head
            if codel is not None:
                is_short = self.n_bytes - n_bytes <= self._longest_bytes
                if codel.drops(now_ns - offered_ns, is_short, now_ns):
                    self._leave(head, now_ns, dropped=True)
                    continue
            self._line.send(n_bytes, offered_ns)
            return head
        return None

    def _leave(self, message: tuple[Any, int, int], left_ns: int, dropped: bool) -> None:
        item, n_bytes, offered_ns = message
        self.n_packets -= 1
        self.n_bytes -= n_bytes
        self._departed.append(Departed(item, offered_ns, left_ns, dropped))


def _codel_of(rate: Rate) -> CoDel | None:
    return CoDel.of(rate.queue) if isinstance(rate.queue, CoDelPart) else None


def _control(rate: Rate | None) -> tuple[float, float] | None:
    queue = None if rate is None else rate.queue
    return (queue.target_ms, queue.interval_ms) if isinstance(queue, CoDelPart) else None
