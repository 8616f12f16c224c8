"""Transmission of the messages at the head of a queue: at a bit rate, at recorded opportunities, or not at all."""

from bisect import bisect_right
from collections.abc import Mapping
from fractions import Fraction
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tis.common.scenario.network.capacity import Capacity, RecordedRate
from tis.common.trace import Trace

NS_PER_BYTE_AT_1_KBIT_S: Final = 8_000_000
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


class Line:
    """A line in exact arithmetic: the fraction of a nanosecond lost by rounding an end up is carried over.

    So n successive bytes take ``n * 8e6 / kbit_s`` ns, rounded up once, for any division into messages and for any
    number of changes of the bit rate (oracle: fractions, tests/netem/link/queue/test_line and
    tests/netem/link/test_changing_rate). The bit rate is the exact value of its decimal notation; None: no time.
    """

    __slots__ = ("_numerator", "_spare", "_unit", "free_ns")

    def __init__(self, kbit_s: float | None) -> None:
        self._numerator, self._unit = _per_byte(kbit_s)
        self.free_ns = 0
        """The first whole nanosecond at which everything has been sent."""
        self._spare = 0  # in 1/unit ns, 0 to unit - 1: how much earlier than ``free_ns`` the line is free

    def send(self, n_bytes: int, ready_ns: int) -> int:
        """Send a message that is ready at ``ready_ns``, after the earlier ones; return the new ``free_ns``."""
        begin_ns, spare = (self.free_ns, self._spare) if ready_ns < self.free_ns else (ready_ns, 0)
        whole, self._spare = divmod(spare - n_bytes * self._numerator, self._unit)
        self.free_ns = begin_ns - whole
        return self.free_ns

    def left(self, now_ns: int) -> Fraction:
        """Return the bytes that are left at ``now_ns``, exactly."""
        if self.free_ns <= now_ns:
            return Fraction(0)
        return Fraction((self.free_ns - now_ns) * self._unit - self._spare, self._numerator)

    def resume(self, left: Fraction, now_ns: int) -> None:
        """Send the bytes that another transmission left at ``now_ns``."""
        # The bytes left are a fraction with the old numerator as denominator, so the unit becomes finer. Instants of
        # changes are whole ns, so it does not become finer than all numerators of a busy period together require.
        self._numerator, self._unit = self._numerator * left.denominator, self._unit * left.denominator
        whole, self._spare = divmod(int(-left * self._numerator), self._unit)
        self.free_ns = now_ns - whole


def _per_byte(kbit_s: float | None) -> tuple[int, int]:
    """Return the ns per byte as numerator and denominator."""
    if kbit_s is None:
        return 0, 1
    return (NS_PER_BYTE_AT_1_KBIT_S / Fraction(str(kbit_s))).as_integer_ratio()


class Opportunities:
    """A transmission that sends some bytes at each instant of a recording, and nothing between them, as mahimahi's.

    The rest of an opportunity goes to the next messages that waited for it; what nobody waited for is lost. A message
    that becomes ready at an opportunity waits for the next one. The recording repeats from its last instant on, as
    there. Oracle: a loop over single opportunities, tests/netem/link/queue/test_opportunities.

    ``at_ns`` (N,) does not descend, its last element is positive; ``n_bytes`` is what each opportunity sends.
    """

    def __init__(self, at_ns: NDArray[np.int64], n_bytes: int) -> None:
        self.free_ns = 0
        self._at_ns: list[int] = at_ns.tolist()
        self._n_bytes = n_bytes
        self._next = 0  # number of the first opportunity that is not used, over all repetitions
        self._rest = 0  # bytes left of the opportunity at ``free_ns``

    def send(self, n_bytes: int, ready_ns: int) -> int:
        """Send a message that is ready at ``ready_ns``, after the earlier ones; return the new ``free_ns``."""
        if ready_ns >= self.free_ns:
            self._rest = 0
            self._next = max(self._next, self._first_after(ready_ns))
        self._take(n_bytes)
        return self.free_ns

    def left(self, now_ns: int) -> Fraction:
        """Return the bytes that are left at ``now_ns``."""
        if self.free_ns <= now_ns:
            return Fraction(0)
        return Fraction((self._next - self._first_after(now_ns)) * self._n_bytes - self._rest)

    def resume(self, left: Fraction, now_ns: int) -> None:
        """Send the bytes that another transmission left at ``now_ns``; a begun byte is sent again."""
        self._rest, self._next, self.free_ns = 0, self._first_after(now_ns), now_ns
        self._take(-int(-left // 1))

    def _take(self, n_bytes: int) -> None:
        if n_bytes > self._rest:
            n_needed = -(-(n_bytes - self._rest) // self._n_bytes)
            self._next += n_needed
            self._rest += n_needed * self._n_bytes
            self.free_ns = self._instant_ns(self._next - 1)
        self._rest -= n_bytes

    def _first_after(self, now_ns: int) -> int:
        round_number, into_ns = divmod(now_ns, self._at_ns[-1])
        return round_number * len(self._at_ns) + bisect_right(self._at_ns, into_ns)

    def _instant_ns(self, number: int) -> int:
        round_number, index = divmod(number, len(self._at_ns))
        return round_number * self._at_ns[-1] + self._at_ns[index]


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
