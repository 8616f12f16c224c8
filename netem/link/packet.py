"""A packet on a link: its flow, its fate, its state and its memory while it is held, and its departure."""

from typing import Any, Final

from msgspec import Struct

from tis.common.messages import header_numbers
from tis.common.records import Departure, Outcome
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Ordering as OrderingName
from tis.netem.stages.impairment import Impairment
from tis.netem.stages.loss.recovery import Terms
from tis.netem.stages.ordering import Ordering, build_ordering

MAX_COPIED_BYTES: Final = 16_384
"""Payload up to which the live emulator copies a message that waits."""

_COPIED_BYTES: Final = 1_000
_SHARED_BYTES: Final = 10_000
MARKS: Final = frozenset(("query", "reply", "end", "token"))


def held_bytes(n_bytes: int, copied: bool = True) -> int:
    """Return the memory of a held message with ``n_bytes`` of payload and attachment, so that buffers bound memory.

    Not ``copied``, as queries, replies and large messages, it also keeps the buffer in which Zenoh received it. The
    emulator in virtual time holds messages without a buffer, but must decide as the live one does. The figures are
    the growth of a process (resident set) with thousands of messages held (tests/netem/bridge/test_memory).
    """
    return n_bytes + (_COPIED_BYTES if copied and n_bytes <= MAX_COPIED_BYTES else _SHARED_BYTES)


class Flow:
    """The state of one name. Without an ``impairment`` its packets are refused; ``is_open``: no stage holds them.

    ``n_queued`` of its packets wait for a rate, the last one in the queue of the group ``queue``, and ``n_awaited``
    for a repeat of what a reliable transport lost. ``latest_ns`` is the latest release instant so far, ``terms`` are
    its latest packet's, of a recovery. ``looked_ns`` and ``activity`` are of the last look whether it is idle.
    """

    __slots__ = (
        "activity", "changes", "group", "impairment", "is_copied", "is_open", "latest_ns", "looked_ns", "n_awaited",
        "n_queued", "n_unnumbered", "name", "ordering", "orderings", "queue", "terms",
    )  # fmt: skip

    def __init__(self, name: str, impairment: Impairment | None, group: str) -> None:
        self.name = name
        self.impairment = impairment
        self.group = group
        self.is_open = impairment is not None and impairment.is_open
        self.is_copied = flow_key(name) == name  # queries and replies keep Zenoh's objects
        self.n_unnumbered = 0
        self.n_queued = 0
        self.n_awaited = 0
        self.latest_ns = 0
        self.looked_ns = 0
        self.activity = 0
        self.terms: Terms | None = None
        self.queue = group
        self.changes: tuple[Change, ...] = ()
        self.orderings: dict[OrderingName, Ordering] = {}
        self.ordering = self.ordered("reorder" if impairment is None else impairment.ordering)

    def number(self, attachment: bytes, run_id: int | None) -> tuple[int, bool]:
        """Return a packet's sequence number, and whether it is foreign: without the run's header, and numbered here.

        ``run_id`` None stands for any run.
        """
        numbers = header_numbers(attachment)
        if numbers is not None and (run_id is None or numbers[2] == run_id):
            return numbers[0], False
        self.n_unnumbered += 1
        return self.n_unnumbered - 1, True

    def ordered(self, name: OrderingName) -> Ordering:
        """Return the ordering of that name, with its memory of this flow."""
        return self.orderings.setdefault(name, build_ordering(name))


def flow_key(name: str) -> str:
    """Return the key of a flow's name: queries, replies and tokens have a mark and a space before the key."""
    mark, _, key = name.partition(" ")
    return key if mark in MARKS else name


class Fate(Struct, frozen=True):
    """The decision for one packet when it is offered; instants in ns of run time.

    ``release_ns`` is None when the packet is dropped, and while the queue of a rate has not transmitted it or a
    recovery makes it wait. ``recovered``: its first sending is lost, and repeated.
    """

    seq: int
    outcome: Outcome
    delay_ns: int = 0
    release_ns: int | None = None
    n_copies: int = 0
    n_flips: int = 0
    foreign: bool = False
    recovered: bool = False


class Packet(Struct, eq=False):
    """A packet, or its copy, from its offer until it leaves: released, or dropped after all.

    ``item`` is the object that was offered, ``memory`` what it occupies, ``number`` counts the packets offered to the
    link. With ``terms`` it belongs to the connection that repeats what is lost: ``is_lost`` tells of its first
    sending, ``recovered_ns`` how much later it is due. ``departure`` is None while it waits for the queue of a rate
    or for its release instant; ``release_ns`` is None as long as that instant is unknown.
    """

    flow: Flow
    item: Any
    seq: int
    copy_index: int
    offered_ns: int
    delay_ns: int
    n_bytes: int
    memory: int
    n_flips: int
    foreign: bool
    number: int
    ordering: Ordering
    queued_ns: int = 0
    is_lost: bool = False
    terms: Terms | None = None
    recovered_ns: int = 0
    release_ns: int | None = None
    departure: Departure | None = None

    @property
    def name(self) -> str:
        """Return the name of its flow."""
        return self.flow.name
