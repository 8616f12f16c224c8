"""What one direction of a network is fitted to: the messages that count, and what is known beside them."""

from dataclasses import dataclass
from typing import NamedTuple

from common.trace import Trace
from netem.fit.measuring import Spread, measuring_adds


class Flips(NamedTuple):
    """Messages whose payload had bits flipped, and in the middle one how many."""

    n: int
    bits: int


@dataclass(frozen=True, eq=False)
class DirectionRecord:
    """A trace with what its maker knows; what a trace alone cannot say is None.

    ``adds`` is how far apart measuring alone puts equal delays. ``overtaken`` is the share of messages that left
    after a later one, ``n_dropped_late`` how many were dropped for that, ``n_copied`` how many came twice.
    ``left_out`` says in words, with counts, which messages are not in the trace.
    """

    trace: Trace
    adds: Spread
    overtaken: float | None = None
    n_dropped_late: int | None = None
    n_copied: int | None = None
    flips: Flips | None = None
    left_out: tuple[str, ...] = ()

    @classmethod
    def of(cls, trace: Trace) -> "DirectionRecord":
        """Return a trace by itself as a record; raises `DataError` where its header cannot be read."""
        return cls(trace, measuring_adds(trace))
