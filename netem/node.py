"""The network emulator in virtual time: a state machine of two links, from the west to the east and back."""

from collections.abc import Callable, Sequence

from tis.common.channels import DESTINATION, ORIGIN, Network
from tis.common.node import Arrival, Emission, Output, Record
from tis.common.zenoh_syntax import NO_KEYS, KeySet
from tis.netem.link.ledger import last_records
from tis.netem.link.link import Link
from tis.netem.link.packet import Packet


class NetemNode:
    """Two links between two networks; payload and attachment pass unchanged, except for flipped bits.

    ``local`` are keys that stay on their network. The live driver of the same links is `tis.netem.bridge.bridge`.
    """

    name = "netem"

    def __init__(self, forward: Link, feedback: Link, local: KeySet = NO_KEYS) -> None:
        self.local = local
        self.links: dict[Network, Link] = {ORIGIN["forward"]: forward, ORIGIN["feedback"]: feedback}

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return every key of both networks: a key without a rule is refused, which is counted."""
        return [(network, "**") for network in self.links]

    def publishes(self) -> Sequence[tuple[Network, str]]:
        """Return no key: the keys are known only when packets arrive."""
        return ()

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Decide the packet's fate, its delay counted from ``recv_ns``; without a delay it leaves at once."""
        if arrival.key in self.local or ("*" in arrival.key and self.local):
            return ()
        link = self.links[arrival.network]
        now_ns = arrival.recv_ns
        link.offer(arrival.key, arrival.attachment, len(arrival.payload), now_ns, arrival)
        link.note_queue_depth(now_ns)
        next_ns = link.next_release_ns()
        left = self._release(link, now_ns) if next_ns is not None and next_ns <= now_ns else []
        return [*left, *self._full_batches(link, now_ns)]

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Release all packets due at ``now_ns``, each link in the order of its release instants."""
        outputs = [output for link in self.links.values() for output in self._release(link, now_ns)]
        for link in self.links.values():
            outputs += self._full_batches(link, now_ns)
        return outputs

    def next_wake_ns(self) -> int | None:
        """Return the next release of either link; None while nothing is held."""
        instants = [ns for link in self.links.values() if (ns := link.next_release_ns()) is not None]
        return min(instants, default=None)

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the last batches and the counters; packets still held are counted as such."""
        return last_records((link.ledger for link in self.links.values()), self.counters(), now_ns)

    def counters(self) -> dict[str, int]:
        """Return the counts of both links, by name (``forward.dropped.loss``)."""
        return {name: n for link in self.links.values() for name, n in link.counters().items()}

    def _release(self, link: Link, now_ns: int) -> list[Output]:
        outputs: list[Output] = []
        for packet in link.release(now_ns):
            if packet.departure != "released":
                link.left(packet, now_ns)
                continue
            arrival: Arrival = packet.item
            outputs.append(
                Emission(
                    network=DESTINATION[link.direction],
                    key=arrival.key,
                    payload=link.payload(packet, arrival.payload),
                    attachment=arrival.attachment,
                    on_sent=_recording(link, packet),
                )
            )
        return outputs

    @staticmethod
    def _full_batches(link: Link, now_ns: int) -> list[Record]:
        return link.ledger.close(now_ns)() if link.ledger.is_full(now_ns) else []


def _recording(link: Link, packet: Packet) -> Callable[[int], Sequence[Record]]:
    """Return a callback that records when a packet was sent."""

    def record(released_ns: int) -> Sequence[Record]:
        link.left(packet, released_ns)
        return ()

    return record
