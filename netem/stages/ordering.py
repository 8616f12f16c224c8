"""Ordering: the treatment of packets of one key that would overtake each other."""

from typing import Final

from tis.common.scenario.network.pipeline import Ordering as OrderingName


class Ordering:
    """The ordering of one key's packets: a state that sees each packet when it is offered and when it is due.

    This one is ``reorder``: packets overtake each other as their delays decide.
    """

    __slots__ = ()

    def schedule(self, due_ns: int) -> int:
        """Return the release instant of a packet due at ``due_ns``; called in the order of offering."""
        return due_ns

    def passes(self, number: int) -> bool:  # noqa: ARG002
        """Return whether a packet may leave at its release instant; called in the order of release.

        ``number`` grows with each packet offered, and is the same for a packet and its copy. It is not the sequence
        number, with which a restarted sender begins again.
        """
        return True


class Fifo(Ordering):
    """A packet waits for all packets offered before it, as in a queue; this increases the mean delay."""

    __slots__ = ("_last_ns",)

    def __init__(self) -> None:
        self._last_ns: int | None = None

    def schedule(self, due_ns: int) -> int:
        """Return the later of ``due_ns`` and the previous release instant; ties keep the order of offering."""
        last_ns = self._last_ns
        if last_ns is not None and last_ns > due_ns:
            return last_ns
        self._last_ns = due_ns
        return due_ns


class DropLate(Ordering):
    """A packet that one offered later has overtaken is dropped; copies of the newest packet pass."""

    __slots__ = ("_newest",)

    def __init__(self) -> None:
        self._newest = -1

    def passes(self, number: int) -> bool:
        """Return whether no packet with a greater number has left."""
        if number < self._newest:
            return False
        self._newest = number
        return True


_BY_NAME: Final[dict[OrderingName, type[Ordering]]] = {"reorder": Ordering, "fifo": Fifo, "drop_late": DropLate}


def build_ordering(name: OrderingName) -> Ordering:
    """Return the initial state of an ordering by its name in a scenario."""
    return _BY_NAME[name]()
