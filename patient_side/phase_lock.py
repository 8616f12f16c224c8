"""Ticks that follow the arrivals: a phase just behind the usual arrival of samples, from those seen so far.

A pure function of arrivals and ticks, so a replay makes the same decisions.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from common.channels import Hand
from common.metrics.tick_phase import Arrivals, best_phase
from common.units import NS_PER_S

WINDOW: Final = 128
"""Arrivals of each hand that are remembered."""

_LEAST_ARRIVALS: Final = 16
_LEAST_GAIN: Final = 0.02
_LEAST_ERRORS: Final = 4.0


class Shift(NamedTuple):
    """A new phase of the ticks, and the mean age over the window with it and with the phase before."""

    phase_ns: int
    age_ns: float
    age_before_ns: float


@dataclass
class PhaseLock:
    """Looks once a second for the phase with the least mean age of the freshest sample at the ticks.

    It moves only for a gain of more than 2 % of the period and 4 standard errors, and not before 16 arrivals: where
    delays vary by a period and more no phase is better, and one that wanders costs estimators that count in ticks.
    Between 0 and one period, so the order of the ticks stays.
    """

    rate_hz: int
    seen: dict[Hand, deque[tuple[int, int]]] = field(default_factory=dict)
    looked_s: int = 0

    def note(self, hand: Hand, recv_ns: int, sample_ns: int) -> None:
        """Remember an arrival that brought one hand's freshest sample."""
        self.seen.setdefault(hand, deque(maxlen=WINDOW)).append((recv_ns, sample_ns))

    def decide(self, tick: int, phase_ns: int) -> Shift | None:
        """Return the phase from the tick after ``tick`` on; None: as it is."""
        now_s = (tick + 1) // self.rate_hz
        if now_s == self.looked_s:  # not `%`: the tick that ends the second may have been missed
            return None
        self.looked_s = now_s
        if min(map(len, self.seen.values()), default=0) < _LEAST_ARRIVALS:
            return None
        streams = [Arrivals(*np.array(seen, dtype=np.int64).T) for seen in self.seen.values()]
        best = best_phase(streams, self.rate_hz, phase_ns)
        least_ns = max(_LEAST_GAIN * NS_PER_S / self.rate_hz, _LEAST_ERRORS * best.error_ns)
        if best.now_age_ns - best.age_ns <= least_ns:
            return None
        return Shift(best.phase_ns, best.age_ns, best.now_age_ns)
