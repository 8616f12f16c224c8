"""Transmission of the messages at the head of a queue: at a bit rate, at recorded opportunities, or not at all."""

from collections.abc import Mapping
from fractions import Fraction
from typing import Final, NamedTuple, Protocol

from common.scenario.network.capacity import Capacity, RecordedRate
from common.trace import Trace
from netem.link.queue.line import Line
from netem.link.queue.opportunities import Opportunities

NEVER_NS: Final = 1 << 62
_LEAST_KBIT_S: Final = 0.001
_DECIMALS: Final = 3


class Service(NamedTuple):
    """The terms on which a queue is served: its capacity times ``scale``; None: no limit. In a stall, not at all."""

    capacity: Capacity | None
    scale: float = 1.0
    stall: bool = False

    @property
    def is_needed(self) -> bool:
        """Tell whether a message may have to wait."""
        return self.stall or self.capacity is not None

    def equals(self, other: "Service") -> bool:
        """Tell whether the terms are the same; capacities are compared as objects, which is quick."""
        return self.capacity is other.capacity and self[1:] == other[1:]


class Transmission(Protocol):
    """Messages that are sent one after the other; instants are whole ns and do not decrease."""

    free_ns: int
    """The instant at which everything has been sent."""

    def send(self, n_bytes: int, ready_ns: int) -> int:
        """Send a message that is ready at ``ready_ns``, after the earlier ones; return the new ``free_ns``."""
        ...

    def left(self, now_ns: int) -> Fraction:
        """Return the bytes that are left at ``now_ns``."""
        ...

    def resume(self, left: Fraction, now_ns: int) -> None:
        """Send the bytes that another transmission left at ``now_ns``."""
        ...


class Standstill:
    """A transmission that sends nothing: what a stall is."""

    def __init__(self) -> None:
        self.free_ns = 0
        self._left = Fraction(0)

    def send(self, n_bytes: int, ready_ns: int) -> int:  # noqa: ARG002
        """Keep a message."""
        return self._keep(Fraction(n_bytes))

    def left(self, now_ns: int) -> Fraction:  # noqa: ARG002
        """Return the bytes that wait."""
        return self._left

    def resume(self, left: Fraction, now_ns: int) -> None:  # noqa: ARG002
        """Keep the bytes that another transmission left."""
        self._keep(left)

    def _keep(self, left: Fraction) -> int:
        # also what has no bytes left: it is sent at the end of the stall, not in it
        self._left, self.free_ns = left, NEVER_NS
        return self.free_ns


def transmission_of(service: Service, traces: Mapping[str, Trace]) -> Transmission:
    """Return an idle transmission on these terms; ``traces`` has every recording that a capacity names."""
    capacity, scale = service.capacity, service.scale
    if service.stall:
        return Standstill()
    if capacity is None:
        return Line(None)
    if isinstance(capacity, RecordedRate):
        n_bytes = max(1, round(capacity.opportunity_bytes * scale))
        return Opportunities(traces[capacity.opportunities].sent_ns, n_bytes)
    # Whole bits per second: with the digits of any float the exact arithmetic of a ramp would grow step by step.
    scaled = capacity.kbit_s if scale == 1.0 else round(capacity.kbit_s * scale, _DECIMALS)
    return Line(max(scaled, _LEAST_KBIT_S))
