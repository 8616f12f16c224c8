"""The record to which one direction of a network is fitted: a trace and further counts."""

from dataclasses import dataclass
from typing import NamedTuple

from tis.common.trace import Trace
from tis.netem.fit.measuring import Spread, measuring_adds


class Flips(NamedTuple):
    """The number of messages with flipped bits, and the median number of bits flipped."""

    n: int
    bits: int


@dataclass(frozen=True, eq=False)
class DirectionRecord:
    """A trace and what else is known of it; None where only a trace is known.

    ``adds`` is the spread that measuring adds to equal delays. ``overtaken`` is the share of messages that left after
    a later one, ``n_dropped_late`` the number dropped for that reason, ``n_copied`` the number that arrived twice.
    ``left_out`` describes the messages that are not in the trace, with counts. ``drawn``: the delays are those that
    netem decided, before ordering.
    """

    trace: Trace
    adds: Spread
    overtaken: float | None = None
    n_dropped_late: int | None = None
    n_copied: int | None = None
    flips: Flips | None = None
    left_out: tuple[str, ...] = ()
    drawn: bool = False

    @classmethod
    def of(cls, trace: Trace) -> "DirectionRecord":
        """Return the record of a trace alone; raises `DataError` if its header is invalid."""
        return cls(trace, measuring_adds(trace))
