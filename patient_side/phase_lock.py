"""The phase lock: a phase of the ticks just behind the usual arrival of samples, from the recent arrivals.

A pure function of arrivals and ticks, so a replay makes the same decisions.
"""

from collections import deque
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from tis.common.channels import Hand
from tis.common.metrics.age_of_information import Arrivals, best_phase
from tis.common.units import NS_PER_S

WINDOW: Final = 128
"""Number of arrivals of each hand that a decision is based on."""

_MIN_ARRIVALS: Final = 16
_MIN_GAIN: Final = 0.02
_MIN_STANDARD_ERRORS: Final = 4.0


class Shift(NamedTuple):
    """A new phase of the ticks, and the mean age over the window with the new and with the old phase."""

    phase_ns: int
    age_ns: float
    age_before_ns: float


@dataclass
class PhaseLock:
    """Re-evaluates once a second which phase minimises the mean age of the freshest sample at the ticks.

    The phase changes only for a gain of more than 2 % of the period and 4 standard errors, and not before 16
    arrivals: where delays vary by a period or more no phase is better, and a wandering one harms estimators that
    count in ticks. It stays between 0 and one period, which preserves the order of the ticks.
    """

    rate_hz: int
    seen: dict[Hand, deque[tuple[int, int]]] = field(default_factory=dict)
    evaluated_s: int = 0

    def note(self, hand: Hand, recv_ns: int, sample_ns: int) -> None:
        """Record an arrival that brought one hand's freshest sample."""
        self.seen.setdefault(hand, deque(maxlen=WINDOW)).append((recv_ns, sample_ns))

    def decide(self, tick: int, phase_ns: int) -> Shift | None:
        """Return the phase from the tick after ``tick`` on; None where it does not change."""
        now_s = (tick + 1) // self.rate_hz
        if now_s == self.evaluated_s:  # not `%`: the tick that ends the second may have been missed
            return None
        self.evaluated_s = now_s
        if min(map(len, self.seen.values()), default=0) < _MIN_ARRIVALS:
            return None
        streams = [Arrivals(*np.array(seen, dtype=np.int64).T) for seen in self.seen.values()]
        best = best_phase(streams, self.rate_hz, phase_ns)
        threshold_ns = max(_MIN_GAIN * NS_PER_S / self.rate_hz, _MIN_STANDARD_ERRORS * best.error_ns)
        if best.now_age_ns - best.age_ns <= threshold_ns:
            return None
        return Shift(best.phase_ns, best.age_ns, best.now_age_ns)
