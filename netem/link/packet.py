"""A packet on a link: its fate, its state while it is held, and its departure."""

from typing import Any, NamedTuple

from tis.common.records import Departure, Outcome
from tis.netem.link.flow import Flow
from tis.netem.link.memory import held_bytes


class Fate(NamedTuple):
    """The decision for one packet when it is offered; instants in ns of run time.

    ``release_ns`` is None when the packet is dropped, and while the queue of a rate has not transmitted it.
    """

    seq: int
    outcome: Outcome
    delay_ns: int = 0
    release_ns: int | None = None
    n_copies: int = 0
    n_flips: int = 0
    foreign: bool = False


class Due(NamedTuple):
    """A packet that leaves the link: released, or dropped after all; ``item`` is the object that was offered.

    ``release_ns`` is None when the packet was dropped before its release instant was known.
    """

    item: Any
    name: str
    seq: int
    copy_index: int
    offered_ns: int
    release_ns: int | None
    queued_ns: int
    departure: Departure
    n_flips: int
    foreign: bool


class Held:
    """A packet, or its copy, that waits for the queue of a rate or for its release instant.

    ``number`` counts the packets offered to the link.
    """

    __slots__ = (
        "copy_index", "delay_ns", "flow", "foreign", "gone", "item", "memory", "n_bytes", "n_flips", "number",
        "offered_ns", "ordering", "queued_ns", "release_ns", "seq",
    )  # fmt: skip

    def __init__(
        self, flow: Flow, item: Any, seq: int, copy_index: int, offered_ns: int, delay_ns: int, n_bytes: int,
        n_flips: int, foreign: bool, number: int,
    ) -> None:  # fmt: skip
        self.flow = flow
        self.ordering = flow.ordering
        self.item = item
        self.seq = seq
        self.copy_index = copy_index
        self.offered_ns = offered_ns
        self.delay_ns = delay_ns
        self.n_bytes = n_bytes
        self.memory = held_bytes(n_bytes, flow.is_copied)
        self.n_flips = n_flips
        self.foreign = foreign
        self.number = number
        self.queued_ns = 0
        self.release_ns: int | None = None
        self.gone = False

    def due(self, departure: Departure) -> Due:
        """Return the packet as it leaves."""
        return Due(
            self.item, self.flow.name, self.seq, self.copy_index, self.offered_ns, self.release_ns, self.queued_ns,
            departure, self.n_flips, self.foreign,
        )  # fmt: skip
