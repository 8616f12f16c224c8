"""Point-to-point movements of minimum jerk, successive or overlapping.

Source: Flash and Hogan, "The coordination of arm movements", J. Neuroscience 5 (1985); overlapping movements
add up (Flash and Henis, "Arm trajectory modifications during reaching", 1991).
"""

from dataclasses import dataclass

import numpy as np

from tis.common.sources.trajectory import Array


def minimum_jerk(phase: Array) -> Array:
    """Return the share of a movement done at ``phase`` p of its duration: 10 p^3 - 15 p^4 + 6 p^5, 0 <= p <= 1.

    Oracle: the tests solve the boundary-value problem (sixth derivative zero, rest at both ends).
    """
    p = np.clip(phase, 0.0, 1.0)
    return np.asarray(p**3 * (10.0 + p * (-15.0 + 6.0 * p)))


@dataclass(frozen=True)
class Movements:
    """M movements in D dimensions, in the order of their onsets.

    ``onset_s`` and ``duration_s`` are (M,); ``target`` (M + 1, D) is the resting position before the first movement
    and after each.
    """

    onset_s: Array
    duration_s: Array
    target: Array

    def at(self, t_s: Array) -> Array:
        """Return the positions (N, D) at times (N,). Oracle: the plain sum over all movements."""
        last = np.searchsorted(self.onset_s, t_s, side="right") - 1
        position = self.target[last + 1]
        # First every movement that has begun is taken as complete, then its remaining part is subtracted. Only as
        # many movements back as ever overlap can be incomplete.
        begun = np.searchsorted(self.onset_s, self.onset_s + self.duration_s)
        for lag in range(int(np.max(begun - np.arange(len(begun))))):
            i = np.maximum(last - lag, 0)
            to_come = 1.0 - minimum_jerk((t_s - self.onset_s[i]) / self.duration_s[i])
            to_come[last < lag] = 0.0
            position = position - to_come[:, np.newaxis] * (self.target[i + 1] - self.target[i])
        return position
