"""What measuring a delay adds to its spread: below that no network can be told from a constant delay."""

import re
from math import inf
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from common.errors import DataError, Fault
from common.trace import Trace
from common.units import NS_PER_MS, NS_PER_US

MEASURING_ADDS: Final = "measuring_adds_ms"
"""The line of a trace's header that says how far apart delays lay on the machine that measured, without a network."""

_MARGIN: Final = 3  # probes through `tis netem` with a constant delay, on a busy machine: 0.2 to 2 times (p95 - p5)
_COARSEST_NS: Final = NS_PER_MS  # no clock and no program that prints delays rounds to more
_LEAST_NS: Final = NS_PER_US
_WORDS: Final = re.compile(r"([0-9]+(?:\.[0-9]+)?) \(p95 - p5\), ([0-9]+(?:\.[0-9]+)?) \(max - min\)", re.ASCII)


class Spread(NamedTuple):
    """How far delays lie apart, in ns: most of them, p95 - p5, nearly all, p99 - p1, and all."""

    most_ns: float
    nearly_all_ns: float
    all_ns: float

    @classmethod
    def of(cls, delay_ns: NDArray[np.int64]) -> Self:
        """Return the spread of delays, (N,), N > 0 (oracle: literals, tests/netem/fit/test_measuring)."""
        p1, p5, p95, p99 = np.percentile(delay_ns, [1, 5, 95, 99])
        return cls(float(p95 - p5), float(p99 - p1), float(delay_ns.max() - delay_ns.min()))

    def within(self, other: "Spread") -> bool:
        """Tell whether none is larger than the other's."""
        return all(mine <= others for mine, others in zip(self, other, strict=True))

    @property
    def words(self) -> str:
        """Return it as the header's line `MEASURING_ADDS` has it."""
        return f"{self.most_ns / NS_PER_MS:.6f} (p95 - p5), {self.all_ns / NS_PER_MS:.6f} (max - min)"


NOTHING_ADDED: Final = Spread(_LEAST_NS, _LEAST_NS, _LEAST_NS)
"""For delays that are known and not measured: what differs by less than a microsecond is one delay all the same."""


def measuring_adds(trace: Trace) -> Spread:
    """Return what measuring added to a trace's spread: by its header, or else what its digits can tell apart.

    The header's line `MEASURING_ADDS` is the spread of an idle relay on the machine that measured. Another process on
    it may have `_MARGIN` times that; and since a machine's stalls come seldom and in bursts, so that no p99 of theirs
    is sure, nearly all delays may lie that many times as far apart
    as all of the relay's, and one in a hundred anywhere. Raises
    `DataError` where the line is another.
    """
    resolution_ns = _resolution_ns(trace.delay_ns[trace.delay_ns >= 0])
    digits = max(_LEAST_NS, resolution_ns)
    said = trace.about.get(MEASURING_ADDS)
    if said is None:
        return Spread(digits, digits, digits)
    found = _WORDS.fullmatch(said.strip())
    if found is None:
        rule = "must be like '0.05 (p95 - p5), 0.3 (max - min)'"
        raise DataError(Fault(trace.label, MEASURING_ADDS, rule, said))
    most_ns, nearly_all_ns = (_MARGIN * float(ms) * NS_PER_MS for ms in found.groups())
    return Spread(max(digits, most_ns), max(digits, nearly_all_ns), inf)


def _resolution_ns(delay_ns: NDArray[np.int64]) -> int:
    """Return the largest power of ten ns, at most 1 ms, of which all delays are multiples."""
    step_ns = _COARSEST_NS
    while step_ns > 1 and np.any(delay_ns % step_ns):
        step_ns //= 10
    return step_ns
