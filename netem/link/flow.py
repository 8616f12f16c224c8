"""A flow: the packets of one name on a link, and their shared state."""

from typing import Final

from tis.common.header import header_numbers
from tis.common.scenario.network.conditions import Change
from tis.common.scenario.network.pipeline import Ordering as OrderingName
from tis.netem.stages.impairment import Impairment
from tis.netem.stages.ordering import Ordering, build_ordering

MARKS: Final = frozenset(("query", "reply", "end", "token"))


class Flow:
    """The state of one name. Without an ``impairment`` its packets are refused; ``is_open``: no stage holds them.

    ``n_queued`` of its packets wait for a rate, the last one in the queue of the group ``queue``; ``latest_ns`` is
    the latest release instant so far.
    """

    __slots__ = (
        "changes", "group", "impairment", "is_copied", "is_open", "latest_ns", "n_queued", "n_unnumbered", "name",
        "ordering", "orderings", "queue",
    )  # fmt: skip

    def __init__(self, name: str, impairment: Impairment | None, group: str) -> None:
        self.name = name
        self.impairment = impairment
        self.group = group
        self.is_open = impairment is not None and impairment.is_open
        self.is_copied = flow_key(name) == name  # queries and replies keep Zenoh's objects
        self.n_unnumbered = 0
        self.n_queued = 0
        self.latest_ns = 0
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
