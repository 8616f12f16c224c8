"""The record to which one direction of a network is fitted: a trace, further counts, and what measuring added.

Below the spread that measuring adds to delays, a network cannot be distinguished from a constant delay.
"""

import re
from dataclasses import dataclass
from math import inf
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from tis.common.errors import DataError, Fault
from tis.common.trace import Trace
from tis.common.units import NS_PER_MS, NS_PER_US

MEASURING_ADDS: Final = "measuring_adds_ms"
"""The header line of a trace with the spread of delays on the measuring machine without a network."""

_MARGIN: Final = 3  # probes through `tis netem` with a constant delay, on a busy machine: 0.2 to 2 times (p95 - p5)
_MAX_RESOLUTION_NS: Final = NS_PER_MS  # no clock or program rounds delays to more
_MIN_NS: Final = NS_PER_US
_WORDS: Final = re.compile(r"([0-9]+(?:\.[0-9]+)?) \(p95 - p5\), ([0-9]+(?:\.[0-9]+)?) \(max - min\)", re.ASCII)


def rounded(value: float, digits: int = 4) -> float:
    """Return a fitted parameter with as many significant digits as a profile states."""
    return float(f"{value:.{digits}g}")


class Spread(NamedTuple):
    """The spread of delays, in ns: of most (p95 - p5), of nearly all (p99 - p1) and of all (max - min)."""

    most_ns: float
    nearly_all_ns: float
    all_ns: float

    @classmethod
    def of(cls, delay_ns: NDArray[np.int64]) -> Self:
        """Return the spread of delays, (N,), N > 0 (oracle: literals, tests/netem/fit/test_measuring)."""
        p1, p5, p95, p99 = np.percentile(delay_ns, [1, 5, 95, 99])
        return cls(float(p95 - p5), float(p99 - p1), float(delay_ns.max() - delay_ns.min()))

    def within(self, other: "Spread") -> bool:
        """Tell whether no component is larger than the other's."""
        return all(mine <= others for mine, others in zip(self, other, strict=True))

    @property
    def words(self) -> str:
        """Return the text of the header line `MEASURING_ADDS`."""
        return f"{self.most_ns / NS_PER_MS:.6f} (p95 - p5), {self.all_ns / NS_PER_MS:.6f} (max - min)"


NOTHING_ADDED: Final = Spread(_MIN_NS, _MIN_NS, _MIN_NS)
"""For delays that are known, not measured: differences below a microsecond do not count."""


def measuring_adds(trace: Trace) -> Spread:
    """Return the spread that measuring added to a trace: by its header, else the resolution of its digits.

    The header line `MEASURING_ADDS` is the spread of an idle relay on the measuring machine; another process may have
    `_MARGIN` times that. Stalls are rare and come in bursts, so their p99 is uncertain: nearly all delays may spread
    `_MARGIN` times as far as all of the relay's, and one in a hundred without a bound. Raises `DataError` for an
    invalid line.
    """
    resolution_ns = _resolution_ns(trace.delay_ns[trace.delay_ns >= 0])
    digits = max(_MIN_NS, resolution_ns)
    line = trace.about.get(MEASURING_ADDS)
    if line is None:
        return Spread(digits, digits, digits)
    found = _WORDS.fullmatch(line.strip())
    if found is None:
        rule = "must be like '0.05 (p95 - p5), 0.3 (max - min)'"
        raise DataError(Fault(trace.label, MEASURING_ADDS, rule, line))
    most_ns, nearly_all_ns = (_MARGIN * float(ms) * NS_PER_MS for ms in found.groups())
    return Spread(max(digits, most_ns), max(digits, nearly_all_ns), inf)


def _resolution_ns(delay_ns: NDArray[np.int64]) -> int:
    """Return the largest power of ten ns, at most 1 ms, that divides all delays."""
    step_ns = _MAX_RESOLUTION_NS
    while step_ns > 1 and np.any(delay_ns % step_ns):
        step_ns //= 10
    return step_ns


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
    netem decided, before ordering. ``key`` is that of a run's messages, "" where there is none.
    """

    trace: Trace
    adds: Spread
    overtaken: float | None = None
    n_dropped_late: int | None = None
    n_copied: int | None = None
    flips: Flips | None = None
    left_out: tuple[str, ...] = ()
    drawn: bool = False
    key: str = ""

    @classmethod
    def of(cls, trace: Trace) -> Self:
        """Return the record of a trace alone; raises `DataError` if its header is invalid."""
        return cls(trace, measuring_adds(trace))
