"""The network emulator as a state machine: two links, from the west to the east and back."""

from collections.abc import Callable, Sequence

from common.channels import DESTINATION, ORIGIN, Direction, Network
from common.node import Arrival, Emission, Output, Record
from common.records import COUNTERS, FATES, RELEASES, CounterNote, FateNote, ReleaseNote
from netem.link import Due, Link


class NetemNode:
    """Two links between two networks; payload, attachment and passport are handed on as they came."""

    name = "netem"

    def __init__(self, forward: Link, feedback: Link) -> None:
        self._links: dict[Network, Link] = {ORIGIN["forward"]: forward, ORIGIN["feedback"]: feedback}

    def listens(self) -> Sequence[tuple[Network, str]]:
        """Return every key of both networks: a key without a rule is refused, which is counted."""
        return [(network, "**") for network in self._links]

    def receive(self, arrival: Arrival) -> Sequence[Output]:
        """Decide the packet's fate, its delay counted from ``recv_ns``; without a delay it leaves at once."""
        link = self._links[arrival.network]
        now_ns = arrival.recv_ns
        fate = link.offer(arrival, now_ns)
        note = FateNote(
            direction=link.direction,
            key=arrival.key,
            seq=fate.seq,
            offered_ns=now_ns,
            outcome=fate.outcome,
            delay_ns=fate.delay_ns,
            release_ns=fate.release_ns,
            n_bytes=len(arrival.payload),
            foreign=fate.foreign,
        )
        record = Record(FATES, now_ns, note, seq=fate.seq)
        if fate.outcome == "deliver" and fate.release_ns <= now_ns:
            return [record, *self._leave(link, now_ns)]
        return [record]

    def wake(self, now_ns: int) -> Sequence[Output]:
        """Let go of what is due at ``now_ns``, each link in the order of its release instants."""
        return [output for link in self._links.values() for output in self._leave(link, now_ns)]

    def next_wake_ns(self) -> int | None:
        """Return the next release of either link; None while nothing is held."""
        instants = [ns for link in self._links.values() if (ns := link.next_release_ns()) is not None]
        return min(instants, default=None)

    def finish(self, now_ns: int) -> Sequence[Record]:
        """Return the counters; what is still held stays so and is counted as such."""
        return [
            Record(COUNTERS, now_ns, CounterNote(name=name, value=value)) for name, value in self.counters().items()
        ]

    def counters(self) -> dict[str, int]:
        """Return the counts of both links, like ``forward.dropped.loss``."""
        return {name: n for link in self._links.values() for name, n in link.counters().items()}

    def _leave(self, link: Link, now_ns: int) -> list[Output]:
        direction = link.direction
        network = DESTINATION[direction]
        outputs: list[Output] = []
        for due in link.release(now_ns):
            packet = due.packet
            if due.late:
                outputs.append(_release_record(direction, due, now_ns))
                continue
            outputs.append(
                Emission(
                    network=network,
                    key=packet.key,
                    payload=packet.payload,
                    attachment=packet.attachment,
                    on_sent=_reporter(direction, due),
                    passport=packet.passport,
                )
            )
        return outputs


def _reporter(direction: Direction, due: Due) -> Callable[[int], Sequence[Record]]:
    return lambda released_ns: [_release_record(direction, due, released_ns)]


def _release_record(direction: Direction, due: Due, released_ns: int) -> Record:
    note = ReleaseNote(
        direction=direction,
        key=due.packet.key,
        seq=due.seq,
        offered_ns=due.packet.recv_ns,
        release_ns=due.release_ns,
        released_ns=released_ns,
        late=due.late,
        foreign=due.foreign,
    )
    return Record(RELEASES, released_ns, note, seq=due.seq)
