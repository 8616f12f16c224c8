"""The network emulator as a state machine: two links, from the west to the east and back."""

from collections.abc import Callable, Sequence

from common.channels import DESTINATION, ORIGIN, Network
from common.node import Arrival, Emission, Output, Record
from common.records import COUNTERS, CounterNote
from netem.link.ledger import Ledger
from netem.link.link import Link
from netem.link.packet import Due
from netem.stages.corruption import flip_bits


class NetemNode:
    """Two links between two networks; payload and attachment are handed on as they came.

    Live, `netem.bridge.bridge` drives the same links.
    """

    name = "netem"

    def __init__(self, forward: Link, feedback: Link) -> None:
        self.links: dict[Network, Link] = {ORIGIN["forward"]: forward, ORIGIN["feedback"]: feedback}
        self._ledgers = {link.direction: Ledger(link.direction) for link in (forward, feedback)}

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return every key of both networks: a key without a rule is refused, which is counted."""
        return [(network, "**") for network in self.links]

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return no key: which ones come is known when they do."""
        return ()

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Decide the packet's fate, its delay counted from ``recv_ns``; without a delay it leaves at once."""
        link = self.links[arrival.network]
        now_ns, n_bytes = arrival.recv_ns, len(arrival.payload)
        fate = link.offer(arrival.key, arrival.attachment, n_bytes, now_ns, arrival)
        ledger = self._ledgers[link.direction]
        ledger.decided(arrival.key, fate, now_ns, n_bytes)
        if link.has_queues:
            ledger.queue_depth(now_ns, *link.queue_depth())
        next_ns = link.next_release_ns()
        left = self._leave(link, now_ns) if next_ns is not None and next_ns <= now_ns else []
        return [*left, *self._close_books(ledger, now_ns)]

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Let go of what is due at ``now_ns``, each link in the order of its release instants."""
        outputs = [output for link in self.links.values() for output in self._leave(link, now_ns)]
        for ledger in self._ledgers.values():
            outputs += self._close_books(ledger, now_ns)
        return outputs

    def next_wake_ns(self) -> int | None:
        """Return the next release of either link; None while nothing is held."""
        instants = [ns for link in self.links.values() if (ns := link.next_release_ns()) is not None]
        return min(instants, default=None)

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the last batches and the counters; what is still held stays so and is counted as such."""
        records = [record for ledger in self._ledgers.values() for record in ledger.close(now_ns)()]
        return records + [
            Record(COUNTERS, now_ns, CounterNote(name=name, value=value)) for name, value in self.counters().items()
        ]

    def counters(self) -> dict[str, int]:
        """Return the counts of both links, like ``forward.dropped.loss``."""
        return {name: n for link in self.links.values() for name, n in link.counters().items()}

    def _leave(self, link: Link, now_ns: int) -> list[Output]:
        ledger = self._ledgers[link.direction]
        outputs: list[Output] = []
        for due in link.release(now_ns):
            if due.departure != "released":
                ledger.left(due, now_ns)
                continue
            packet: Arrival = due.item
            payload = packet.payload
            if due.n_flips:
                payload = flip_bits(payload, due.seq, due.n_flips, link.address(due.name))
            outputs.append(
                Emission(
                    network=DESTINATION[link.direction],
                    key=packet.key,
                    payload=payload,
                    attachment=packet.attachment,
                    on_sent=_entering(ledger, due),
                )
            )
        return outputs

    @staticmethod
    def _close_books(ledger: Ledger, now_ns: int) -> list[Record]:
        return ledger.close(now_ns)() if ledger.is_full(now_ns) else []


def _entering(ledger: Ledger, due: Due) -> Callable[[int], Sequence[Record]]:
    def enter(released_ns: int) -> Sequence[Record]:
        ledger.left(due, released_ns)
        return ()

    return enter
