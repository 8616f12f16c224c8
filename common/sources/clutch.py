"""The clutch of the master console: a pedal that uncouples both arms while the masters are moved back.

The hands come to rest, the pedal is pressed, the masters move, the pedal is released, the work continues. Working
time stands still meanwhile. The arm is half the master's movement plus a constant, which each clutch action changes.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from common.sources.minimum_jerk import Movements
from common.sources.trajectory import Array
from common.streams import Stream

EASE_S: Final = 0.3
"""Time in which the hands come to rest before the pedal is pressed, and resume speed afterwards."""
PRESSED_S: Final = 1.0
"""Time during which the pedal is pressed."""

_STRETCH_S: Final = 2.0 * EASE_S + PRESSED_S
_LOST_S: Final = EASE_S + PRESSED_S  # each of the two easings costs half of its duration
_AWAY_MM: Final = 40.0
_FIRST_BATCH: Final = 16


@dataclass(frozen=True)
class Clutch:
    """Instants (K >= 1,) in s at which the hands begin to come to rest, at least one clutch action apart."""

    onset_s: Array

    @classmethod
    def pressed(cls, per_min: float, stream: Stream, until_s: float) -> "Clutch":
        """Return clutch actions until after ``until_s``, ``per_min`` (0 to 37, exclusive), with exponential gaps."""
        n_stretches = _FIRST_BATCH
        while True:
            gap_s = -(60.0 / per_min - _STRETCH_S) * np.log(stream.uniforms(0, n_stretches))
            onset_s = np.cumsum(gap_s + _STRETCH_S) - _STRETCH_S
            if onset_s[-1] > until_s:
                return cls(onset_s)
            n_stretches *= 2

    def working_s(self, t_s: Array) -> Array:
        """Return the working time (N,) in s at times (N,). Oracle: its rate, integrated."""
        begun = np.searchsorted(self.onset_s, t_s, side="right")
        into_s = t_s - self.onset_s[np.maximum(begun - 1, 0)]
        off = np.clip(into_s / EASE_S, 0.0, 1.0)
        on = np.clip((into_s - EASE_S - PRESSED_S) / EASE_S, 0.0, 1.0)
        lost_s = EASE_S * (_eased(off) + on - _eased(on)) + np.clip(into_s - EASE_S, 0.0, PRESSED_S)
        return np.asarray(np.where(begun > 0, t_s - _LOST_S * (begun - 1) - lost_s, t_s))

    def moved_mm(self, stream: Stream, t_s: Array) -> Array:
        """Return the displacement (N, 3) of a master by its clutch actions, in mm."""
        places = np.zeros((len(self.onset_s) + 1, 3))
        places[1:] = _AWAY_MM * (2.0 * stream.uniforms(0, 3 * len(self.onset_s)).reshape(-1, 3) - 1.0)
        lasting_s = np.full(len(self.onset_s), PRESSED_S)
        return Movements(self.onset_s + EASE_S, lasting_s, places).at(t_s)


def _eased(phase: Array) -> Array:
    """Return the integral of `minimum_jerk` from 0 to ``phase``."""
    return np.asarray(phase**4 * (2.5 + phase * (-3.0 + phase)))
