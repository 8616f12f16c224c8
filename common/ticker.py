"""Absolute ticks: tick k is due at ``k * 10**9 // rate_hz + phase_ns``, independently of earlier lateness."""

from dataclasses import dataclass

from tis.common.units import NS_PER_S, sample_instant_ns


@dataclass
class Ticker:
    """Ticks 0..n_ticks-1, with a count of the missed ones (not begun before the next one is due)."""

    rate_hz: int
    n_ticks: int
    phase_ns: int = 0
    k: int = 0
    n_missed: int = 0

    def due_ns(self, k: int) -> int:
        """Return the nominal instant of tick ``k`` in run time."""
        return sample_instant_ns(k, self.rate_hz) + self.phase_ns

    def next_due_ns(self) -> int | None:
        """Return when the next tick is due; None after the last."""
        return self.due_ns(self.k) if self.k < self.n_ticks else None

    def start_at(self, from_ns: int) -> None:
        """Begin with the first tick that is due at ``from_ns`` or later (oracle: a linear scan in the tests)."""
        # floor(k * 10^9 / rate) is at least an integer x exactly where k is at least x * rate / 10^9
        self.k = min(max(0, -(-(from_ns - self.phase_ns) * self.rate_hz // NS_PER_S)), self.n_ticks)

    def skip_missed(self, now_ns: int) -> range:
        """Skip and count the ticks that can no longer begin in time; return their numbers.

        Afterwards ``k`` is the tick in whose period ``now_ns`` falls (oracle: a linear scan in the tests).
        """
        # A tick is missed when the next one is due already, so it may begin late by less than a period.
        first = self.k
        while self.k < self.n_ticks and now_ns >= self.due_ns(self.k + 1):
            self.k += 1
        self.n_missed += self.k - first
        return range(first, self.k)

    def begin(self) -> int:
        """Begin the current tick: return its number and advance to the next."""
        self.k += 1
        return self.k - 1
