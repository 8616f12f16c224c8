"""Ordering: what becomes of a packet that would overtake an earlier one of its key, or be overtaken."""

from dataclasses import dataclass
from typing import Protocol

from common.scenario.network.pipeline import Ordering as OrderingName


class Ordering(Protocol):
    """The order of one key's packets: a state that sees them twice, when offered and when due."""

    def schedule(self, due_ns: int) -> int:
        """Return when a packet leaves that is due at ``due_ns``; called in the order of offering."""
        ...

    def passes(self, seq: int) -> bool:
        """Return whether a packet may still leave at its release; called in the order of release."""
        ...


class Reorder:
    """Packets overtake each other as their delays have it."""

    __slots__ = ()

    def schedule(self, due_ns: int) -> int:
        """Return ``due_ns``."""
        return due_ns

    def passes(self, seq: int) -> bool:  # noqa: ARG002
        """Return True."""
        return True


@dataclass(slots=True)
class Fifo:
    """A packet waits for those that were offered before it, as in a queue; this lengthens the mean delay."""

    _last_ns: int | None = None

    def schedule(self, due_ns: int) -> int:
        """Return the later of ``due_ns`` and the release before; ties are broken by offering."""
        last_ns = self._last_ns
        if last_ns is not None and last_ns > due_ns:
            return last_ns
        self._last_ns = due_ns
        return due_ns

    def passes(self, seq: int) -> bool:  # noqa: ARG002
        """Return True."""
        return True


@dataclass(slots=True)
class DropLate:
    """A packet that a newer one has overtaken is dropped; duplicates of the newest pass."""

    _newest: int = -1

    def schedule(self, due_ns: int) -> int:
        """Return ``due_ns``."""
        return due_ns

    def passes(self, seq: int) -> bool:
        """Return whether no packet of a greater sequence number has left."""
        if seq < self._newest:
            return False
        self._newest = seq
        return True


def build_ordering(name: OrderingName) -> Ordering:
    """Return the initial state of the ordering that a scenario names."""
    match name:
        case "fifo":
            return Fifo()
        case "reorder":
            return Reorder()
        case "drop_late":
            return DropLate()
