"""Weber's deadband: a sample is sent where it differs from the last one sent by more than a person would notice."""

from dataclasses import dataclass
from math import dist
from typing import Final

from tis.common.vector import Vector, size

LEAST: Final = 1e-5
"""Added to the size that a change is compared with, so that a sample of size zero never divides (N or m/s)."""


@dataclass
class Deadband:
    """Decides which samples of one direction are sent; the receiver holds the last one.

    A sample is sent if it is the first, if ``|x - last| / (|last| + 1e-5) >= share``, or if nothing was sent for
    ``keep_alive_ns``. With a share of 0 every sample is sent. Rule of the open HapticCommLib (TU Munich, 2017).
    Oracles: the number of packets of a growth at a constant ratio in closed form, test_deadband.
    """

    share: float
    keep_alive_ns: int | None = None
    last: Vector | None = None
    sent_ns: int = 0
    n_sent: int = 0
    n_suppressed: int = 0

    def is_sent(self, value: Vector, t_ns: int) -> bool:
        """Tell whether the sample at ``t_ns`` is sent, and count it."""
        is_due = (
            self.last is None
            or dist(value, self.last) >= self.share * (size(self.last) + LEAST)
            or (self.keep_alive_ns is not None and t_ns - self.sent_ns >= self.keep_alive_ns)
        )
        if not is_due:
            self.n_suppressed += 1
            return False
        self.last, self.sent_ns = value, t_ns
        self.n_sent += 1
        return True
