"""A link, one direction of the network: packets are offered, held as long as the models say, and released."""

from collections.abc import Iterable
from heapq import heappop, heappush
from typing import Final, Literal, NamedTuple

from common.channels import Direction
from common.header import Header
from common.node import Arrival
from netem.disorder import Ordering, build_ordering
from netem.impairment import Impairment
from netem.outage import Outages
from netem.rules import RuleTable

Outcome = Literal["deliver", "loss", "outage", "refused", "overflow"]
DROPS: Final = ("loss", "outage", "refused", "overflow", "late")

MAX_HELD: Final = 200_000


class Fate(NamedTuple):
    """What was decided for one packet when it was offered; without delivery both times are 0."""

    seq: int
    outcome: Outcome
    delay_ns: int
    release_ns: int
    foreign: bool = False


class Due(NamedTuple):
    """A packet whose release is due; ``late``: a newer one of its key has overtaken it, so it is dropped."""

    packet: Arrival
    seq: int
    release_ns: int
    late: bool
    foreign: bool = False


class _Flow:
    """One key's state; ``impairment`` None: the key is refused."""

    __slots__ = ("impairment", "n_unnumbered", "ordering")

    def __init__(self, impairment: Impairment | None, ordering: Ordering) -> None:
        self.impairment = impairment
        self.ordering = ordering
        self.n_unnumbered = 0


class Link:
    """One direction. Always ``offered == released + dropped + held`` (tests/netem/test_link, by hypothesis).

    ``max_held`` bounds the memory: a packet that finds so many held is dropped and counted as overflow.
    """

    def __init__(
        self,
        direction: Direction,
        rules: RuleTable,
        seed: int,
        outages: Outages | None = None,
        max_held: int = MAX_HELD,
    ) -> None:
        self.direction: Final = direction
        self.offered = 0
        self.released = 0
        self.dropped: dict[str, int] = dict.fromkeys(DROPS, 0)
        self._rules = rules
        self._seed = seed
        self._outages = outages
        self._max_held = max_held
        self._flows: dict[str, _Flow] = {}
        # (release_ns, number of the offer, ...): the number breaks ties, so the flows are never compared
        self._heap: list[tuple[int, int, int, bool, _Flow, Arrival]] = []

    def prepare(self, keys: Iterable[str]) -> None:
        """Open the flows of keys that are expected and make their first draws, so that no packet waits for that."""
        for key in keys:
            flow = self._flows.get(key) or self._open(key)
            if flow.impairment is not None:
                flow.impairment.decide(0, -1)

    @property
    def held(self) -> int:
        """Number of packets that wait for their release."""
        return len(self._heap)

    def offer(self, packet: Arrival, now_ns: int) -> Fate:
        """Decide the fate of ``packet`` and, when it is to leave, hold it; its delay counts from ``now_ns``.

        The sequence number is the header's when the attachment is ours, else a count of such packets by key.
        """
        self.offered += 1
        flow = self._flows.get(packet.key) or self._open(packet.key)
        header = Header.unpack(packet.attachment)
        if header is None:
            seq = flow.n_unnumbered
            flow.n_unnumbered = seq + 1
        else:
            seq = header.seq
        foreign = header is None
        if flow.impairment is None:
            return self._drop(seq, "refused", foreign)
        outcome, delay_ns = flow.impairment.decide(seq, now_ns)
        if outcome != "deliver":
            return self._drop(seq, outcome, foreign)
        if len(self._heap) >= self._max_held:
            return self._drop(seq, "overflow", foreign)
        release_ns = flow.ordering.schedule(now_ns + delay_ns)
        heappush(self._heap, (release_ns, self.offered, seq, foreign, flow, packet))
        return Fate(seq, "deliver", delay_ns, release_ns, foreign)

    def next_release_ns(self) -> int | None:
        """Return the instant of the next release; None while nothing is held."""
        return self._heap[0][0] if self._heap else None

    def release(self, now_ns: int) -> list[Due]:
        """Return the packets due at ``now_ns``, by release instant, equal ones in the order of offering.

        Those that are late are returned too, so that they can be logged, and counted as dropped.
        """
        heap = self._heap
        due: list[Due] = []
        while heap and heap[0][0] <= now_ns:
            release_ns, _, seq, foreign, flow, packet = heappop(heap)
            late = not flow.ordering.passes(seq)
            if late:
                self.dropped["late"] += 1
            else:
                self.released += 1
            due.append(Due(packet, seq, release_ns, late, foreign))
        return due

    def counters(self) -> dict[str, int]:
        """Return what was counted, by name; ``held_at_end`` is what is held now."""
        counts = {"offered": self.offered, "released": self.released}
        counts |= {f"dropped.{cause}": count for cause, count in self.dropped.items()}
        counts["held_at_end"] = self.held
        return {f"{self.direction}.{name}": count for name, count in counts.items()}

    def _open(self, key: str) -> _Flow:
        pipeline = self._rules.pipeline(key)
        if pipeline is None:
            flow = _Flow(None, build_ordering("reorder"))
        else:
            impairment = Impairment(pipeline, self._seed, self.direction, key, self._outages)
            flow = _Flow(impairment, build_ordering(pipeline.ordering))
        self._flows[key] = flow
        return flow

    def _drop(self, seq: int, outcome: Outcome, foreign: bool) -> Fate:
        self.dropped[outcome] += 1
        return Fate(seq, outcome, 0, 0, foreign)
